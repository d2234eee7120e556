// A device and a hand that exist in memory only: the impedance of an arm that follows a target.
#pragma once

#include <functional>
#include <memory>

#include "palpate/devices/device_models.h"
#include "palpate/haptics/device.h"

namespace palpate {

/// The arm: mass, damping and stiffness towards where it wants to be (typical of a human grip).
struct HandModel {
  double mass = 0.15;              ///< kg, added to the device's own
  double damping = 3;              ///< N s/m
  double stiffness = 150;          ///< N/m
  double angular_inertia = 2e-4;   ///< kg m2
  double angular_damping = 0.01;   ///< N m s/rad
  double angular_stiffness = 0.5;  ///< N m/rad
};

/// Where the hand wants the handle at time t (s since start), in B.
using HandTarget = std::function<Pose(double time)>;

struct SimulatedDeviceOptions {
  DeviceModel model;
  HandModel hand;
  HandTarget target;               ///< empty: rests at the origin
  double rate = 1000;              ///< ticks per second, 100..8000
  double quantum = 0;              ///< m, position resolution (encoders); 0: none
  double velocity_filter = 0.005;  ///< s, of the velocity estimate from positions
  /// True: ticks follow the computer's clock, in a thread of its own. False: `run` computes them as
  /// fast as it can on a simulated clock, for tests.
  bool in_real_time = true;
};

class SimulatedDevice : public HapticDevice {
 public:
  /// Errors: options out of range.
  static Result<std::unique_ptr<SimulatedDevice>> create(const SimulatedDeviceOptions& options);

  /// Not in real time: so many ticks. start() first.
  virtual void run(int num_ticks) = 0;
  /// The true state of the hand, and the net energy that the device has given it so far, J.
  virtual DeviceState true_state() const = 0;
  virtual double energy_given() const = 0;
};

}  // namespace palpate
