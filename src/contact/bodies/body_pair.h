// A pair of bodies, sphere by sphere: the overlap of two spheres, and the wrenches that follow.
// Shared code for host and device.
#pragma once

#include <cmath>
#include <cstdint>

#include "palpate/contact/body_contact.h"

namespace palpate { inline namespace v0 {

/// A sphere of A and one of B, or inner nodes of their trees.
struct SpherePair {
  double radius_a = 0, radius_b = 0;
  Vec3d offset;  ///< from the center of B's to that of A's
  double distance2 = 0;

  PALPATE_HOSTDEV SpherePair(double a, double b, const Vec3d& offset_ba)
      : radius_a(a), radius_b(b), offset(offset_ba), distance2(dot(offset_ba, offset_ba)) {}

  PALPATE_HOSTDEV bool overlaps() const {
    const double reach = radius_a + radius_b;
    return distance2 < reach * reach;
  }
  PALPATE_HOSTDEV double distance() const { return std::sqrt(distance2); }
};

/// Volume that a pair of spheres shares, and the force on A's.
struct SharedLens {
  double volume = 0;
  Vec3d force;

  PALPATE_HOSTDEV explicit SharedLens(const SpherePair& pair) {
    const double distance = pair.distance();
    volume = lens_volume<double>(pair.radius_a, pair.radius_b, distance);
    if (distance > 0) force = (volume / distance) * pair.offset;
  }
};

/// Sums over all pairs of two bodies, in the frame of A.
struct BodySums {
  double volume = 0;
  Vec3d force_A, torque_A;  ///< on A, about its center of mass
  std::int64_t num_pairs = 0;
  int num_touched_a = 0, num_touched_b = 0;  ///< spheres
};

/// Adds the moments of one pair to those of all.
inline void add_moments(const VolumeMoments& part, VolumeMoments& sum) {
  for (int i = 0; i < 3; ++i) {
    for (int j = 0; j < 3; ++j) sum.first[i][j] += part.first[i][j];
  }
  sum.polar += part.polar;
}

/// Returns X_AB from the poses of both in W.
PALPATE_HOSTDEV inline Pose relative_pose(const Pose& X_WA, const Pose& X_WB) {
  return inverse(Pose{X_WA.translation, normalized(X_WA.rotation)}) *
         Pose{X_WB.translation, normalized(X_WB.rotation)};
}

/// Computes the wrenches on the bodies.
BodyPenetration body_penetration(const BodySums& sums, const Tool& a, const Tool& b,
                                 const Pose& X_WA, const Pose& X_WB);

/// True if a pose is not finite; sets the status.
bool is_non_finite(const Pose& X_WA, const Pose& X_WB, BodyPenetration& result);

}}  // namespace palpate::v0
