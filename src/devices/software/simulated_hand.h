// A hand on a handle: the mechanics behind SimulatedDevice, without clocks and sensors.
#pragma once

#include "palpate/devices/devices.h"

namespace palpate { inline namespace v0 {

/// Exact motion of mass, damper and spring under a constant force, one step at a time: whatever the
/// step, it neither adds nor loses energy of its own.
class ImpedanceStep {
 public:
  ImpedanceStep(double mass, double damping, double stiffness, double seconds);

  /// `stretch` of the spring, its rate of change, and what else accelerates the mass, m/s2.
  void operator()(Vec3d& stretch, Vec3d& rate, const Vec3d& acceleration) const;

 private:
  double m_[2][3];  // (stretch, rate) from (stretch, rate, acceleration)
};

/// Mass of device and hand, damping of the mechanism against B, spring and damper of the hand
/// towards a moving target. The same for rotation, where the spring pulls along the rotation vector
/// between target and handle. The edge of the workspace is a hard stop without rebound.
class SimulatedHand {
 public:
  SimulatedHand(const DeviceModel& model, const HandModel& hand, HandTarget target,
                double tick_seconds);

  /// At rest where the target begins.
  void reset();
  /// One tick under a constant wrench of the device.
  void advance(const Wrench& F_H_B);

  const Pose& X_BH() const { return X_BH_; }
  const Twist& V_BH() const { return V_BH_; }
  double energy_given() const { return energy_given_; }  ///< J, work of the device's wrench

 private:
  static constexpr int kSubSteps = 4;  // the exact solution is for straight targets and small turns

  Pose target_at(double tick) const;
  void move(const Wrench& F_H_B, const Pose& X_BTarget, const Twist& V_BTarget);

  DeviceModel model_;
  HandModel hand_;
  HandTarget target_;
  double tick_seconds_;
  ImpedanceStep linear_, angular_;

  double num_ticks_ = 0;
  Pose X_BTarget_;
  Pose X_BH_;
  Twist V_BH_;
  double energy_given_ = 0;
};

/// Target of a hand that explores the scene before it: it sets out at the back of the workspace,
/// moves forward along the z axis of B and back again once in 8 s (to 0.6 workspace radii on
/// either side of the origin), circles around this axis once in 3 s, and tilts by up to 0.15 rad.
/// With the default X_WB, B looks as the camera does: forward is into the scene.
HandTarget exploring_hand(double workspace_radius);

}}  // namespace palpate::v0
