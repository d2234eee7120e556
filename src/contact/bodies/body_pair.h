// A pair of bodies, sphere by sphere: what two spheres share, and what follows for the bodies.
// Shared code for host and device.
#pragma once

#include <cmath>
#include <cstdint>

#include "palpate/contact/body_contact.h"

namespace palpate::inline v0 {

/// A sphere of A and one of B. Inner nodes of their trees, too.
struct SpherePair {
  double radius_a = 0, radius_b = 0;
  Vec3d offset;  ///< from the centre of B's to that of A's
  double distance2 = 0;

  PALPATE_HOSTDEV SpherePair(double a, double b, const Vec3d& offset_ba)
      : radius_a(a), radius_b(b), offset(offset_ba), distance2(dot(offset_ba, offset_ba)) {}

  PALPATE_HOSTDEV bool overlaps() const {
    const double reach = radius_a + radius_b;
    return distance2 < reach * reach;
  }
  PALPATE_HOSTDEV double distance() const { return std::sqrt(distance2); }
};

/// What a pair of spheres shares, and the force on A's.
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
  Vec3d force_A, torque_A;  ///< on A, about its centre of mass
  std::int64_t num_pairs = 0;
  int num_touched_a = 0, num_touched_b = 0;  ///< spheres
};

/// X_AB from the poses of both in W.
Pose relative_pose(const Pose& X_WA, const Pose& X_WB);

/// Wrenches on the bodies.
BodyPenetration body_penetration(const BodySums& sums, const Tool& a, const Tool& b,
                                 const Pose& X_WA, const Pose& X_WB);

/// With a pose that is not finite: the status that says so. False if both are finite.
bool is_non_finite(const Pose& X_WA, const Pose& X_WB, BodyPenetration& result);

}  // namespace palpate::inline v0
