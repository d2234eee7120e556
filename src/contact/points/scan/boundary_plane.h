// The plane of a boundary sphere (thesis eq. 3.3), from the sums over its points. Shared code for
// host and device.
#pragma once

#include <cstdint>

#include "src/contact/points/donors/donor.h"

namespace palpate { inline namespace v0 {

/// Rule by which planes follow from sums.
struct BoundaryPlaneRule {
  bool weighted = false;    ///< the sums carry kernel weights (Continuity)
  bool fades_in = false;    ///< a boundary sphere counts as far as points have entered it
  bool with_range = false;  ///< DonorPoint::range is needed
};

/// A sphere that contains points. Without a plane its normal is 0 and it is no donor.
struct BoundarySphere {
  std::int32_t sphere_id = -1;
  Donor donor;  ///< unit mean normal, plane through the mean point, tool frame
  std::int32_t num_points = 0;
  bool is_ambiguous = false;  ///< StepStatus::ambiguous_normals

  PALPATE_HOSTDEV bool has_plane() const { return donor.sphere_id >= 0; }
};

/// Sum of kernel weights at which a boundary sphere counts by half as one (Continuity::entry).
inline constexpr double kHalfPresence = 0.25;

/// Computes a boundary sphere; R_TW and translation_W are those of X_WT.
PALPATE_HOSTDEV inline BoundarySphere boundary_sphere(std::int32_t sphere_id, const PointSums& sums,
                                                      double sum_scale,
                                                      const BoundaryPlaneRule& rule,
                                                      const Mat3d& R_TW,
                                                      const Vec3d& translation_W) {
  BoundarySphere result;
  result.sphere_id = sphere_id;
  result.num_points = static_cast<std::int32_t>(sums.num_points(sum_scale));
  const double weight = rule.weighted ? sums.weight(sum_scale) : sums.num_points(sum_scale);
  // Points that only graze the sphere have no weight.
  if (rule.weighted && !(weight > 1e-6)) return result;
  const Vec3d offset_W = sums.offset(sum_scale) / weight,
              mean_normal_W = sums.normal(sum_scale) / weight;
  const double length = norm(mean_normal_W);
  result.is_ambiguous = length < 0.5;
  // Normals that cancel out: such a sphere has no plane.
  if (!(length > 1e-6)) return result;
  const Vec3d p_T = R_TW * offset_W, n_T = R_TW * (mean_normal_W / length);
  Donor& donor = result.donor;
  donor.sphere_id = sphere_id;
  donor.plane_T = {n_T, dot(n_T, p_T)};
  donor.point = {p_T, rule.with_range ? norm(translation_W + offset_W) : 0};
  donor.weight = weight;
  if (rule.fades_in) {
    const double sum = sums.weight(sum_scale);
    donor.presence = sum / (sum + kHalfPresence);
  }
  return result;
}

}}  // namespace palpate::v0
