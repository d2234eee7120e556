// A cluster of elements that lies deep is measured as one ball: its volume at its centroid. The
// ball asks the field as its elements do, with their mean radius. Wholly inside, these are linear
// in the field, U = -sum V_i phi_i, and all that one ball leaves out is half the bend of the field
// times the second moment of the cluster. So deep, pixels are about as wide as the cluster.
// The depth of the ball says where: phi is minus the distance to free space by any way, out of the
// front, sideways out of a shadow, out of a back or a hole, or to what another camera has seen to
// be free. With w from 0 to 1 between `depth`, where no element is nearer to free space than 1.6
// footprints, and kWholeWidth times more, the cluster has
//
//   U = (1 - w(phi)) U_e + w(phi) U_w,   U_w = -V phi,   D = U_w - U_e,
//
// where U_e is the potential of its elements, with the wrench W_e; for J, the derivative of phi by
// a motion of the tool, its wrench is (1 - w) W_e + (w V - w' D) J, and so on: force and stiffness
// are exact derivatives of one potential. Shared by host and device.
#pragma once

#include "src/contact/field/field_element.h"

namespace palpate { inline namespace v0 {

/// Depth over which a cluster becomes one ball, in WholeClusters::depth.
inline constexpr float kWholeWidth = 1.0f;

/// Returns the share w of the ball, by phi.
template <class Real>
PALPATE_FORMULA Curved<Real> whole_share(Real phi, Real depth) {
  const Real zero{}, one = zero + 1.0f, per_width = (1.0f / kWholeWidth) / depth;
  const Real x = (-phi - depth) * per_width;
  const Sloped<Real> step = smooth_step(x);
  const auto is_between = (x > zero) & (x < one);
  const Real bend = is_between ? 6.0f - 12.0f * x : zero;
  return {step.value, -step.slope * per_width, bend * per_width * per_width};
}

/// Terms of a ball that stands for a share of its cluster, beside the rest of the elements.
template <class Real>
struct WholeTerms {
  Real volume, potential;  ///< that it counts
  Real push;               ///< times the gradient of the field it is the force
  Real disc;               ///< decrease of `push` by phi
};
/// `all`: the volume of the cluster; `of_elements`: their potential.
template <class Real>
PALPATE_FORMULA WholeTerms<Real> whole_terms(const Curved<Real>& share, Real all, Real phi,
                                             Real of_elements) {
  const Real own = -all * phi, apart = own - of_elements;
  return {share.value * all, share.value * own, share.value * all - share.slope * apart,
          share.bend * apart - 2.0f * share.slope * all};
}

/// Adds what the share changes by a motion while the elements push: w' (J W_e^T + W_e J^T). `J`,
/// `W`: force and torque.
template <class Real, class Terms>
PALPATE_FORMULA void add_exchange(Real by_phi, const Real (&J)[6], const Real (&W)[6],
                                  Terms& terms) {
  const auto product = [&](int row, int column) {
    return by_phi * (J[row] * W[column] + W[row] * J[column]);
  };
  subtract_products(product, terms);
}

}}  // namespace palpate::v0
