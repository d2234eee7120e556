// Which donor is nearest to a sphere, decided in single precision as far as that can be, and how
// much a donor weighs: the formulas that the plane stage of host and device share.
#pragma once

#include "src/contact/index/sphere_clusters.h"
#include "src/contact/points/donors/donor.h"
#include "src/core/lanes.h"

namespace palpate::inline v0::PALPATE_ISA_NAMESPACE {

/// Relative slack of comparisons between single-precision distances. Closer calls go to double.
inline constexpr float kSlack = 4e-6f;

PALPATE_FORMULA VecF squared_length(VecF x, VecF y, VecF z) { return x * x + y * y + z * z; }

/// The donor that is nearest to the middle m of a box, and how far it is from there.
struct NearestToMiddle {
  float x, y, z;
  float squared_distance;
};

/// Can a donor b at (x, y, z), its squared distance from m given, be the nearest one to some
/// centre in the box? It is nearer to a point of the box than b*, the donor nearest to m, only if
/// the point lies beyond the plane half way between b* and b, so only if
/// |m - b|^2 - |m - b*|^2 < 2 h . |b - b*|, h the half sides of the box.
PALPATE_FORMULA Mask may_be_nearest(VecF x, VecF y, VecF z, VecF squared_distance,
                                    const NearestToMiddle& best, const Cluster& box) {
  const float slack = best.squared_distance * kSlack + 1e-14f;
  const VecF reach = box.half_size.x * max(x - best.x, best.x - x) +
                     box.half_size.y * max(y - best.y, best.y - y) +
                     box.half_size.z * max(z - best.z, best.z - z);
  const VecF farther = squared_distance * (1 - kSlack) - (best.squared_distance + slack);
  return farther <= 2.0f * reach;
}

/// A plane whose distance from the cluster's middle is less may have a part of its spheres behind
/// it.
PALPATE_FORMULA float reach_with_slack(const Cluster& cluster) {
  return cluster.reach + kSlack * (norm(cluster.centre) + cluster.reach);
}

/// Are two squared distances too much alike to say which is less?
PALPATE_FORMULA Mask is_close_call(VecF least, VecF second) {
  return second <= least * (1 + 2 * kSlack) + 1e-14f;
}

/// A plane farther from the centre of a sphere has all of it on one side; a nearer one may cut it.
PALPATE_FORMULA VecF cut_distance(VecF x, VecF y, VecF z, VecF radius) {
  const VecF size = max(max(x, -x), max(max(y, -y), max(z, -z))) + radius;
  return radius + size * kSlack;
}

/// Weights of a donor, see Priority; `squared` is the squared distance of the centres.
PALPATE_FORMULA VecF gaussian_weight(VecF squared, float doublings_per_square) {
  constexpr float kMaxExponent2 = static_cast<float>(kMaxExponent * kDoublings);
  return exp2_negative(max(-(squared * doublings_per_square), splat(-kMaxExponent2)));
}
/// `along` is how far the donor lies along its own normal, as seen from the sphere.
PALPATE_FORMULA VecF agreement_weight(VecF along, VecF inverse_distance) {
  return max(along * inverse_distance, splat(static_cast<float>(kMinCosine))) * inverse_distance;
}

}  // namespace palpate::inline v0::PALPATE_ISA_NAMESPACE
