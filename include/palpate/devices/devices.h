// Haptic devices: finding and opening them, and simulated devices.
#pragma once

#include <functional>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "palpate/haptics/device.h"
#include "palpate/io/files.h"
#include "palpate/settings/setting_table.h"

namespace palpate { inline namespace v0 {

// Limits of known devices (vendor and CHAI3D 3.3 tables), for simulation and for drivers that do
// not report them.

/// A known device: its limits and its apparent mass.
struct DeviceModel {
  std::string_view key;  ///< e.g. "touch", "omega.6", "inverse3"
  std::string_view name;
  DeviceLimits limits;
  double moving_mass = 0.1;  ///< kg, apparent at the handle
};

/// All known models; the first one is the default.
std::span<const DeviceModel> device_models();
std::optional<DeviceModel> find_device_model(std::string_view key);

// A simulated device with a simulated hand: the impedance of an arm that follows a target.

/// The arm: mass, damping and stiffness toward its target (typical of a human grip).
struct HandModel {
  double mass = 0.15;              ///< kg, in addition to the device's own
  double damping = 3;              ///< N s/m
  double stiffness = 150;          ///< N/m
  double angular_inertia = 2e-4;   ///< kg m2
  double angular_damping = 0.01;   ///< N m s/rad
  double angular_stiffness = 0.5;  ///< N m/rad
};

/// Target pose of the handle at time t (s since start), in B.
using HandTarget = std::function<Pose(double time)>;

/// Options of a simulated device: its model, the hand that holds it, and its sensors.
struct SimulatedDeviceOptions {
  DeviceModel model = {};
  HandModel hand = {};
  HandTarget target = {};          ///< empty: rests at the origin
  double rate = 1000;              ///< ticks per second, 100..8000
  double quantum = 0;              ///< m, position resolution (encoders); 0: none
  double velocity_filter = 0.005;  ///< s, time constant of the velocity estimate from positions
  /// True: ticks follow the computer's clock, in a separate thread. False: `run` computes them as
  /// fast as possible on a simulated clock, for tests.
  bool in_real_time = true;
};
inline void add_settings(SettingTable& t, SimulatedDeviceOptions& o) {
  auto& [model, hand, target, rate, quantum, velocity_filter, in_real_time] = o;
  t.section("simulated device");
  t.add("rate", rate, {100, 8000, "Hz"}, "ticks per second");
  t.add("quantum", quantum, {0, 0.01, "m"}, "position resolution; 0: none");
  t.add("velocity_filter", velocity_filter, {0, 1, "s"}, "time constant of the velocity estimate");
  t.add("moving_mass", model.moving_mass, {1e-3, 100, "kg"}, "of the device");
  t.add("max_force", model.limits.max_force, {0, 1e4, "N"}, "");
  t.add("max_torque", model.limits.max_torque, {0, 1e3, "N m"}, "");
  t.add("workspace_radius", model.limits.workspace_radius, {1e-3, 100, "m"}, "");
  t.add("damping", model.limits.damping, {0, 1e4, "N s/m"}, "of the mechanism");
  t.add("angular_damping", model.limits.angular_damping, {0, 1e3, "N m s/rad"}, "");
  t.section("hand");
  t.add("mass", hand.mass, {0, 100, "kg"}, "");
  t.add("damping", hand.damping, {0, 1e4, "N s/m"}, "");
  t.add("stiffness", hand.stiffness, {0, 1e6, "N/m"}, "");
  t.add("angular_inertia", hand.angular_inertia, {1e-6, 1, "kg m2"}, "");
  t.add("angular_damping", hand.angular_damping, {0, 1e3, "N m s/rad"}, "");
  t.add("angular_stiffness", hand.angular_stiffness, {0, 1e4, "N m/rad"}, "");
}

/// A simulated device in a simulated hand, in real time or as fast as possible.
class SimulatedDevice : public HapticDevice {
 public:
  /// Creates a device. Errors: options out of range.
  static Result<std::unique_ptr<SimulatedDevice>> create(const SimulatedDeviceOptions& options);

  /// With in_real_time = false: computes `num_ticks` ticks. Call start() first.
  virtual void run(int num_ticks) = 0;
  /// The true state of the hand, and the net energy that the device has given it, J.
  virtual DeviceState true_state() const = 0;
  virtual double energy_given() const = 0;  ///< J
};

// A hand in the browser: a page moves the handle and shows the force.

/// A device that ticks 1000 times per second and follows the page that holds its handle, with
/// critically damped motion, never faster than 1 m/s or 10 rad/s. Button 0 is down while a page
/// holds it and its poses are fresh. After a release, silence or disconnect, the handle yields to
/// the force for half a second and then stays, with the button up.
std::unique_ptr<HapticDevice> make_page_device(std::shared_ptr<PageHandle> handle);

// Finding and opening haptic devices by their URI.

/// One device, and whether it is usable on this machine.
struct FoundDevice {
  std::string uri;  ///< e.g. "haply:ws://localhost:10001"
  std::string kind;
  bool is_usable = false;
  std::string what;  ///< the device, or every path and address that was tried
  std::string hint;  ///< if it is not usable: what to do next
};
/// Probes every kind at once; a driver that hangs is given up after 10 s. Moves no device.
std::vector<FoundDevice> find_devices();

/// URI: `sim[:MODEL]`, `replay:FILE`, `spacenav[:SOCKET]`, `haply[:URL]`, `forcedimension[:ID]`,
/// `openhaptics[:NAME]`, `vrpn:NAME@HOST[:PORT]`, `ros2:/POSE_TOPIC[@FRAME]`,
/// `ros2:FRAME@BASE`. Errors:
/// unknown kind; no device: what was tried, and what to do.
Result<std::unique_ptr<HapticDevice>> open_device(std::string_view uri);

/// Plays a path in real time: the handle follows it, in B, without force. `name` is for
/// display.
std::unique_ptr<HapticDevice> make_replay_device(std::string name, std::vector<TimedPose> X_BH);

}}  // namespace palpate::v0
