// The spring between the hand and the tool: six degrees of freedom, no stronger than the device.
#pragma once

#include <limits>

#include "src/haptics/hand.h"

namespace palpate::inline v0 {

/// In the tool's world: see hand.h for what the motion scale does.
struct Spring {
  double stiffness = 0, angular_stiffness = 0;
  /// Beyond the stretch at which these are reached, force and torque stay as they are, along the
  /// stretch: still the gradient of a potential, so a spring that gives back what it was given.
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

/// From the tool to where the hand holds it: of the centre of mass, and the short way round.
Vec6 stretch_between(const Pose& X_WT, const Vec3d& p_WC, const HeldTool& held);

}  // namespace palpate::inline v0
