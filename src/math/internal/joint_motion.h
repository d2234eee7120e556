// Joints: forward kinematics and its transpose, the same text on a CPU and a GPU. The
// frame of a child is that of its joint, turned about the joint's axis or moved along it:
// X_BC = X_BP X_PJ turn(axis, q). A force and a torque about C do a . (torque + (C - o) x force) to
// a joint that turns about the axis a through o, and a . force to one that slides.
#pragma once

#include <cmath>
#include <cstdint>

#include "palpate/math/geometry.h"

namespace palpate { inline namespace v0 {

enum class JointKind : std::uint8_t {
  fixed,
  turning,   ///< revolute and continuous ones, rad
  sliding,   ///< prismatic ones, m
  floating,  ///< and planar ones: no single number says where they are
};

/// Returns the pose of the child of a joint. `axis`: in J, 1 long.
PALPATE_HOSTDEV inline Pose child_of(const Pose& X_BJ, JointKind kind, const Vec3d& axis,
                                     double position) {
  Pose X_BC = X_BJ;
  if (kind == JointKind::turning) {
    const Vec3d v = axis * std::sin(position / 2);
    X_BC.rotation = normalized(X_BJ.rotation * Quaternion{v.x, v.y, v.z, std::cos(position / 2)});
  } else if (kind == JointKind::sliding) {
    X_BC.translation = X_BJ * (axis * position);
  }
  return X_BC;
}

/// Returns what a force and a torque about C do to a joint whose child is at X_WC.
PALPATE_HOSTDEV inline double effort_of(const Pose& X_WC, JointKind kind, const Vec3d& axis,
                                        const Vec3d& C_W, const Vec3d& force, const Vec3d& torque) {
  const Vec3d axis_W = rotate(X_WC.rotation, axis);
  if (kind == JointKind::sliding) return dot(axis_W, force);
  return dot(axis_W, torque + cross(C_W - X_WC.translation, force));
}

}}  // namespace palpate::v0
