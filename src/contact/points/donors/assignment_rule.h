// Formulas of the assignment stage shared by host and device: the donor nearest to a sphere, in
// single precision as far as that decides, and the weight of a donor.
#pragma once

#include "src/contact/index/sphere_clusters.h"
#include "src/contact/points/donors/donor.h"
#include "src/core/internal/lanes.h"

namespace palpate { inline namespace v0 { namespace PALPATE_ISA_NAMESPACE {

/// Relative slack of comparisons between single-precision distances. Closer calls go to double.
inline constexpr float kSlack = 4e-6f;

PALPATE_FORMULA VecF squared_length(VecF x, VecF y, VecF z) { return x * x + y * y + z * z; }

/// The donor nearest to the middle m of a box, and its squared distance from there.
struct NearestToMiddle {
  float x, y, z;
  float squared_distance;
};

/// True if a donor b at (x, y, z), its squared distance from m given, can be nearest to some center
/// in the box. It is nearer to a point of the box than b*, the donor nearest to m, only if the
/// point lies beyond the plane half way between b* and b, so only if |m - b|^2 - |m - b*|^2 < 2 h .
/// |b - b*|, h the half sides of the box.
PALPATE_FORMULA Mask may_be_nearest(VecF x, VecF y, VecF z, VecF squared_distance,
                                    const NearestToMiddle& best, const Cluster& box) {
  const float slack = best.squared_distance * kSlack + 1e-14f;
  const VecF reach = box.half_size.x * max(x - best.x, best.x - x) +
                     box.half_size.y * max(y - best.y, best.y - y) +
                     box.half_size.z * max(z - best.z, best.z - z);
  const VecF farther = squared_distance * (1 - kSlack) - (best.squared_distance + slack);
  return farther <= 2.0f * reach;
}

/// Distance from the cluster's middle within which a plane may have a part of its spheres behind
/// it.
PALPATE_FORMULA float reach_with_slack(const Cluster& cluster) {
  return cluster.reach + kSlack * (norm(cluster.center) + cluster.reach);
}

/// True if two squared distances are too close to tell which is less.
PALPATE_FORMULA Mask is_close_call(VecF least, VecF second) {
  return second <= least * (1 + 2 * kSlack) + 1e-14f;
}

/// Distance from a sphere's center beyond which a plane has all of it on one side.
PALPATE_FORMULA VecF cut_distance(VecF x, VecF y, VecF z, VecF radius) {
  const VecF size = max(max(x, -x), max(max(y, -y), max(z, -z))) + radius;
  return radius + size * kSlack;
}

/// Weights of a donor, see Priority; `squared` is the squared distance of the centers.
PALPATE_FORMULA VecF gaussian_weight(VecF squared, float doublings_per_square) {
  constexpr float kMaxExponent2 = static_cast<float>(kMaxExponent * kDoublings);
  return exp2_negative(max(-(squared * doublings_per_square), splat(-kMaxExponent2)));
}
/// `along`: distance of the donor along its own normal, from the sphere.
PALPATE_FORMULA VecF agreement_weight(VecF along, VecF inverse_distance) {
  return max(along * inverse_distance, splat(static_cast<float>(kMinCosine))) * inverse_distance;
}

}}}  // namespace palpate::v0::PALPATE_ISA_NAMESPACE
