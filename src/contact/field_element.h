// What one element of the tool adds to the field measure: one text for host and device, for single
// numbers and for vectors of them.
#pragma once

#include "palpate/contact/contact_query.h"
#include "palpate/field/field_curvature.h"
#include "palpate/math/sphere.h"

namespace palpate {

/// A ball that counts `factor` times, and the field at its centre.
template <class Real>
struct CutBall {
  Real volume;     ///< behind the surface; times the gradient of the field it is the force
  Real potential;  ///< its integral over the depth
};
template <class Real>
PALPATE_FORMULA CutBall<Real> cut_ball(Real radius, Real factor, Real phi) {
  Real h = radius - phi;
  h = h < Real{} ? Real{} : h;
  h = h > radius + radius ? radius + radius : h;
  const Real whole = factor * (static_cast<float>(4 * kPi / 3) * radius * radius * radius);
  Real deeper = -phi - radius;
  deeper = deeper < Real{} ? Real{} : deeper;
  return {
      factor * (static_cast<float>(kPi / 3) * h * h * (3.0f * radius - h)),
      factor * (static_cast<float>(kPi / 12) * h * h * h * (4.0f * radius - h)) + whole * deeper};
}

/// Adds what an element at lever l from C (in W) contributes to the stiffness. F = sum f V(phi) n
/// with n = grad phi, so dF = sum f (-A n n^T + V H) dc: A is the area of the cut disc, H holds the
/// second derivatives of phi. A motion of the tool by `shift` and a small `turn` about C moves the
/// element by dc = shift + turn x l, and its torque l x F changes with both factors.
PALPATE_HOSTDEV inline void add_stiffness(const DepthFieldView& field, const Vec3d& p_WC,
                                          const Vec3d& l, double r, double factor, Stiffness& sum) {
  if (factor == 0 || sample_field(field, p_WC + l, r).phi >= r) return;
  const CurvedFieldSample s = sample_field_curvature(field, p_WC + l, r);
  const double volume = factor * cap_volume(r, s.phi);
  const double area = s.phi > -r ? factor * kPi * (r * r - s.phi * s.phi) : 0;
  const Vec3d& n = s.gradient;
  const Vec3d force = volume * n;
  for (int column = 0; column < 6; ++column) {
    Vec3d axis;
    axis[column % 3] = 1;
    const Vec3d moved = column < 3 ? axis : cross(axis, l);
    const Vec3d more_force = volume * (s.hessian * moved) - area * dot(n, moved) * n;
    Vec3d more_torque = cross(l, more_force);
    if (column >= 3) more_torque += cross(moved, force);
    for (int row = 0; row < 3; ++row) {
      sum.m[row][column] -= more_force[row];
      sum.m[row + 3][column] -= more_torque[row];
    }
  }
}

/// State of a sphere and the plane that it is cut by, in T.
struct SphereCut {
  SphereState state = SphereState::outside;
  Plane<float> plane;
};
PALPATE_HOSTDEV inline SphereCut cut_of(const DepthFieldView& field, const Pose& X_WT,
                                        const Sphere& sphere) {
  const double radius = sphere.radius;
  const Vec3d c_T = to_double(sphere.centre);
  const FieldSample<double> at = sample_field(field, X_WT * c_T, radius);
  if (at.phi >= radius) return {};
  const Vec3d n_T = normalized(rotate(conjugate(X_WT.rotation), at.gradient));
  return {at.phi > -radius ? SphereState::boundary : SphereState::inside,
          {to_float(n_T), static_cast<float>(dot(n_T, c_T) - at.phi)}};
}

}  // namespace palpate
