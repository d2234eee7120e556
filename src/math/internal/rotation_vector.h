// Rotations as vectors: axis times angle, the short way round.
#pragma once

#include "palpate/math/geometry.h"

namespace palpate { inline namespace v0 {

/// Returns the rotation vector of a unit quaternion; at most pi long.
inline Vec3d rotation_vector(const Quaternion& q) {
  const double sign = q.w < 0 ? -1 : 1;
  const Vec3d v = Vec3d{q.x, q.y, q.z} * sign;
  const double sine = norm(v);
  // 2 atan2(s, c) / s, which is 2 / c for a small s.
  const double factor = sine > 1e-9 ? 2 * std::atan2(sine, sign * q.w) / sine : 2;
  return v * factor;
}

/// Returns the quaternion of a rotation vector: exp(turn).
inline Quaternion rotation_by(const Vec3d& turn) {
  const double angle = norm(turn);
  return angle > 0 ? axis_angle(turn, angle) : Quaternion{};
}

/// Returns the rotation from `from` to `to` in the frame that both are in: to = exp(result) from.
inline Vec3d rotation_between(const Quaternion& from, const Quaternion& to) {
  return rotation_vector(to * conjugate(from));
}

/// Returns exp(turn) q, normalized; q itself for a zero turn.
inline Quaternion rotated(const Quaternion& q, const Vec3d& turn) {
  return norm(turn) > 0 ? normalized(rotation_by(turn) * q) : q;
}

}}  // namespace palpate::v0
