// The final check of a wrench before it goes to a driver, and conversion of drivers' rotations.
#pragma once

#include <cmath>

#include "palpate/haptics/device.h"

namespace palpate::inline v0 {

/// `v`, shortened to `longest` if it is longer; zero if it is not finite.
inline Vec3d shortened(const Vec3d& v, double longest) {
  const double length = norm(v);
  if (!std::isfinite(length)) return {};
  return length > longest ? v * (longest / length) : v;
}

/// What may go to the motors: within the limits each by itself, and zero if anything is not finite.
/// The safety filter has seen to it already; here is where a mistake would reach the hand.
inline Wrench motor_wrench(const Wrench& F, const DeviceLimits& limits) {
  if (!std::isfinite(norm(F.force) + norm(F.torque))) return {};
  return {shortened(F.force, limits.max_force), shortened(F.torque, limits.max_torque)};
}

/// The unit quaternion of a rotation matrix, by the largest of its four components (Shepperd).
inline Quaternion quaternion_of(const Mat3d& R) {
  const auto& m = R.m;
  const double xx = m[0][0], yy = m[1][1], zz = m[2][2];
  Quaternion q;
  if (xx + yy + zz > 0) {
    q = {m[2][1] - m[1][2], m[0][2] - m[2][0], m[1][0] - m[0][1], 1 + xx + yy + zz};
  } else if (xx >= yy && xx >= zz) {
    q = {1 + xx - yy - zz, m[0][1] + m[1][0], m[0][2] + m[2][0], m[2][1] - m[1][2]};
  } else if (yy >= zz) {
    q = {m[0][1] + m[1][0], 1 - xx + yy - zz, m[1][2] + m[2][1], m[0][2] - m[2][0]};
  } else {
    q = {m[0][2] + m[2][0], m[1][2] + m[2][1], 1 - xx - yy + zz, m[1][0] - m[0][1]};
  }
  return normalized(q);
}

}  // namespace palpate::inline v0
