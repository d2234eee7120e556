// Rotation vectors (axis times angle) and quaternions.
#pragma once

#include <cmath>

#include "palpate/math/pose.h"

namespace palpate {

/// Of the shorter way round: at most pi long.
inline Vec3d rotation_vector(const Quaternion& q) {
  const double sign = q.w < 0 ? -1 : 1;
  const Vec3d v = Vec3d{q.x, q.y, q.z} * sign;
  const double sine = norm(v);
  if (sine < 1e-9) return 2 * v;
  return v * (2 * std::atan2(sine, q.w * sign) / sine);
}

inline Quaternion rotation_by(const Vec3d& rotation_vector) {
  const double angle = norm(rotation_vector);
  return angle > 0 ? axis_angle(rotation_vector, angle) : Quaternion{};
}

/// Constant velocities that lead from one pose to another, both in A, in so many seconds.
inline Twist twist_between(const Pose& X_AB, const Pose& X_AC, double seconds) {
  return {(X_AC.translation - X_AB.translation) / seconds,
          rotation_vector(X_AC.rotation * conjugate(X_AB.rotation)) / seconds};
}

/// The pose after motion at constant velocities, both in A.
inline Pose moved(const Pose& X_AB, const Twist& V_AB, double seconds) {
  return {X_AB.translation + V_AB.linear * seconds,
          normalized(rotation_by(V_AB.angular * seconds) * X_AB.rotation)};
}

}  // namespace palpate
