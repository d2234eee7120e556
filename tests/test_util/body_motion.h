// Small motions of bodies, for finite differences of potentials and wrenches.
#pragma once

#include <array>

#include "palpate/math/geometry.h"
#include "tests/test_util/random.h"

namespace palpate::test {

/// Somewhere in a box of this half side, turned by up to 3 rad.
inline Pose random_body_pose(Random& random, double reach) {
  const Quaternion q = random.rotation(3.0);
  return {random.in_box(reach), q};
}

/// The wrench as coordinates: force, then torque.
inline std::array<double, 6> coordinates(const VolumeWrench& w) {
  return {w.force.x, w.force.y, w.force.z, w.torque.x, w.torque.y, w.torque.z};
}

/// X_WA moved by a small step along one of six directions: three translations, and three rotations
/// about axes of W through C.
inline Pose stepped(const Pose& X_WA, const Vec3d& C_A, int direction, double step) {
  Vec3d axis;
  axis[direction % 3] = 1;
  if (direction < 3) return {X_WA.translation + step * axis, X_WA.rotation};
  const Quaternion turn = axis_angle(axis, step);
  const Vec3d C_W = X_WA * C_A;
  return {C_W + rotate(turn, X_WA.translation - C_W), normalized(turn * X_WA.rotation)};
}

}  // namespace palpate::test
