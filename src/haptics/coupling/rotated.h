// Rotates a pose by a rotation vector.
#pragma once

#include "src/math/internal/rotation_vector.h"

namespace palpate { inline namespace v0 {

/// Returns exp(turn) q, normalized; q itself for a zero turn.
inline Quaternion rotated(const Quaternion& q, const Vec3d& turn) {
  return norm(turn) > 0 ? normalized(rotation_by(turn) * q) : q;
}

}}  // namespace palpate::v0
