// Rotates a pose by a rotation vector.
#pragma once

#include "src/math/internal/rotation_vector.h"

namespace palpate { inline namespace v0 {

/// exp(turn) q.
inline Quaternion rotated(const Quaternion& q, const Vec3d& turn) {
  return norm(turn) > 0 ? normalized(rotation_by(turn) * q) : q;
}

}}  // namespace palpate::v0
