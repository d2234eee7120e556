// A pose of a batch in the camera that sees its surface, and its answer back in W: shared by host
// and device.
#pragma once

#include "palpate/contact/contact.h"
#include "src/math/internal/matrix.h"

namespace palpate { inline namespace v0 {

/// Pose of the tool in the camera that sees the surface.
struct BatchPose {
  Pose X_CT;
  Mat3d R_WC;  ///< if there is an X_WC
  bool is_finite = false;
};

PALPATE_HOSTDEV inline BatchPose pose_in_camera(const Pose& X_WT, const Pose* X_WC) {
  const auto sum = [](const Pose& X) {
    const Vec3d& t = X.translation;
    const Quaternion& q = X.rotation;
    return t.x + t.y + t.z + q.x + q.y + q.z + q.w;
  };
  double total = sum(X_WT);
  BatchPose pose;
  pose.X_CT = {X_WT.translation, normalized(X_WT.rotation)};
  if (X_WC != nullptr) {
    total += sum(*X_WC);
    const Pose camera{X_WC->translation, normalized(X_WC->rotation)};
    pose.R_WC = rotation_matrix(camera.rotation);
    pose.X_CT = inverse(camera) * pose.X_CT;
  }
  pose.is_finite = total - total == 0;
  return pose;
}

/// Number of the surface that a pose is measured against; -1: there is no such surface.
PALPATE_HOSTDEV inline int surface_of(const std::int32_t* surface_of_pose, int num_surfaces,
                                      int pose) {
  if (surface_of_pose == nullptr) return num_surfaces == 1 ? 0 : pose;
  const int surface = surface_of_pose[pose];
  return surface >= 0 && surface < num_surfaces ? surface : -1;
}

}}  // namespace palpate::v0
