// Wrenches about other points and in other axes, which change neither work nor power.
#pragma once

#include "palpate/math/geometry.h"

namespace palpate { inline namespace v0 {

/// The same wrench about q_W instead of p_W: the force stays, the torque gains its lever. `Any` is
/// a Wrench or a VolumeWrench.
template <class Any>
Any moved_to(const Vec3d& q_W, const Any& F_p_W, const Vec3d& p_W) {
  return {F_p_W.force, F_p_W.torque + cross(p_W - q_W, F_p_W.force)};
}

/// The same wrench, about the same point, in the axes of A.
template <class Any>
Any expressed_in(const Quaternion& q_WA, const Any& F_W) {
  const Quaternion q_AW = conjugate(q_WA);
  return {rotate(q_AW, F_W.force), rotate(q_AW, F_W.torque)};
}

/// The same wrench about A's origin, in A's axes.
template <class Any>
Any transformed_to(const Pose& X_WA, const Any& F_p_W, const Vec3d& p_W) {
  return expressed_in(X_WA.rotation, moved_to(X_WA.translation, F_p_W, p_W));
}

}}  // namespace palpate::v0
