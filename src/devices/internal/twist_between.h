// Constant velocities between poses.
#pragma once

#include "src/math/internal/rotation_vector.h"

namespace palpate { inline namespace v0 {

/// Constant velocities that lead from one pose to another, both in A, in so many seconds.
inline Twist twist_between(const Pose& X_AB, const Pose& X_AC, double seconds) {
  return {(X_AC.translation - X_AB.translation) / seconds,
          rotation_between(X_AB.rotation, X_AC.rotation) / seconds};
}

/// The pose after motion at constant velocities, both in A.
inline Pose moved(const Pose& X_AB, const Twist& V_AB, double seconds) {
  return {X_AB.translation + V_AB.linear * seconds,
          normalized(rotation_by(V_AB.angular * seconds) * X_AB.rotation)};
}

}}  // namespace palpate::v0
