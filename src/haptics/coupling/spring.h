// The spring between the hand and the tool: six degrees of freedom, no stronger than the device.
#pragma once

#include <limits>

#include "src/haptics/internal/hand.h"

namespace palpate { inline namespace v0 {

/// Spring in the tool's world: hand.h explains the motion scale.
struct Spring {
  double stiffness = 0, angular_stiffness = 0;
  /// Beyond the stretch at which these are reached, force and torque stay constant, along the
  /// stretch: still the gradient of a potential, so the spring returns the energy that it stores.
  double max_force = std::numeric_limits<double>::infinity();
  double max_torque = std::numeric_limits<double>::infinity();

  /// Secant stiffness: wrench = rate * stretch. It bounds the tangent from above, along and across.
  struct Rates {
    double linear = 0, angular = 0;
    Vec6 operator*(const Vec6& stretch) const {
      return {linear * stretch.linear, angular * stretch.angular};
    }
  };
  Rates rates(const Vec6& stretch) const;
  double energy(const Vec6& stretch) const;
};

Spring make_spring(const CouplingOptions& options, const DeviceLimits& limits);

/// Returns the offset from the tool to its held pose: of its center of mass, and the rotation.
Vec6 stretch_between(const Pose& X_WT, const Vec3d& p_WC, const HeldTool& held);

}}  // namespace palpate::v0
