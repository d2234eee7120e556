// Haptic devices: which there are, how they are opened, and simulated ones.
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

namespace palpate::inline v0 {

// Limits of known devices (vendor and CHAI3D 3.3 tables), for simulation and where a driver does
// not tell them.

struct DeviceModel {
  std::string_view key;  ///< e.g. "touch", "omega.6", "inverse3"
  std::string_view name;
  DeviceLimits limits;
  double moving_mass = 0.1;  ///< kg, apparent at the handle
};

/// All of them; the first one is the default.
std::span<const DeviceModel> device_models();
std::optional<DeviceModel> find_device_model(std::string_view key);

// A device and a hand that exist in memory only: the impedance of an arm that follows a target.

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
inline void add_settings(SettingTable& t, SimulatedDeviceOptions& o) {
  auto& [model, hand, target, rate, quantum, velocity_filter, in_real_time] = o;
  t.section("simulated device");
  t.add("rate", rate, {100, 8000, "Hz"}, "ticks per second");
  t.add("quantum", quantum, {0, 0.01, "m"}, "position resolution; 0: none");
  t.add("velocity_filter", velocity_filter, {0, 1, "s"}, "of the velocity estimate");
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

// A hand in a browser: a page moves the handle, and shows what it feels.

/// A device that ticks a thousand times a second and follows the page that holds its handle, by a
/// critically damped motion and never faster than 1 m/s or 10 rad/s. Button 0 is down while a page
/// holds it and its poses are fresh. Who lets go, falls silent or goes away leaves a handle that
/// gives way to what it feels for half a second, and then stays, with the button up.
std::unique_ptr<HapticDevice> make_page_device(std::shared_ptr<PageHandle> handle);

// Finding and opening haptic devices by the words of the command line.

/// What can be used here.
struct FoundDevice {
  std::string uri;  ///< e.g. "haply:ws://localhost:10001"
  std::string kind;
  bool is_usable = false;
  std::string what;  ///< the device, or every path and address that was tried
  std::string hint;  ///< what to do next if it is not usable
};
/// Asks every kind; takes a second at most. Never fails, never moves a device.
std::vector<FoundDevice> find_devices();

/// sim[:MODEL], replay:FILE, spacenav[:SOCKET], haply[:URL], forcedimension[:ID],
/// openhaptics[:NAME], vrpn:NAME@HOST[:PORT], ros2:/POSE_TOPIC[@FRAME], ros2:FRAME@BASE. Errors: no
/// such kind; nothing there: what was tried, and what to do.
Result<std::unique_ptr<HapticDevice>> open_device(std::string_view uri);

/// A path that is played in real time: the handle goes where it says, in B, and feels nothing.
/// `name` is for humans.
std::unique_ptr<HapticDevice> make_replay_device(std::string name, std::vector<TimedPose> X_BH);

}  // namespace palpate::inline v0
