// The interface of a haptic device: pose of the hand in, wrench out. Drivers differ (some are
// polled, some call back from their own thread, some answer one message with one), so the device
// owns the clock and requests the wrench of each tick.
#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <string>

#include "palpate/core/core.h"
#include "palpate/math/geometry.h"

namespace palpate { inline namespace v0 {

/// Safe limits of a device. SI units.
struct DeviceLimits {
  double max_force = 0;              ///< N
  double max_torque = 0;             ///< N m; 0: the device renders no torque
  double max_stiffness = 0;          ///< N/m
  double max_angular_stiffness = 0;  ///< N m/rad
  double max_damping = 0;            ///< N s/m
  double workspace_radius = 0;       ///< m
  double damping = 0;                ///< N s/m, of the mechanism itself: makes it passive
  double angular_damping = 0;        ///< N m s/rad
};

/// Description of a device.
struct DeviceInfo {
  std::string kind = {};  ///< as on the command line: sim, replay, spacenav, haply, ...
  std::string name = {};  ///< for display: model and serial number or address
  DeviceLimits limits = {};
  double rate = 1000;  ///< ticks per second, nominal
  bool senses_orientation = true;
  int num_buttons = 0;
};

/// State of the hand at one tick. Base frame B of the device: x to the right, y up, z toward the
/// hand, the origin in the middle of the workspace. Handle frame H.
struct DeviceState {
  double time = 0;  ///< s, monotonic clock of this computer
  Pose X_BH = {};
  Twist V_BH = {};            ///< of the handle's origin, in B
  std::uint32_t buttons = 0;  ///< bit per button
  bool is_valid = false;      ///< false: the device sent nothing usable this time; the rest is old
  /// False: the motors do not follow the wrench, as the device or its driver has taken the force
  /// away. Also known if the state is not valid.
  bool has_force = true;
};

/// Computes the wrench for the hand from this state: force (N) and torque (N m) at the handle's
/// origin, in B. Called from the device's thread; does not throw, allocate, lock or wait.
using DeviceTick = std::function<Wrench(const DeviceState& state)>;

/// A haptic device. It calls a function at each tick, in its own thread, with the state of the
/// hand, and renders the wrench that the function returns.
class HapticDevice {
 public:
  virtual ~HapticDevice() = default;  ///< stops the device

  /// Its description.
  virtual const DeviceInfo& info() const = 0;
  /// Starts to tick. Errors: the device does not answer, with its message.
  virtual Status start(DeviceTick tick) = 0;
  /// Afterwards no tick runs or starts, and the motors are off. Waits for at most a second, or
  /// three if a driver hangs.
  virtual void stop() noexcept = 0;
  /// An error once the device is lost or has refused to continue: it has stopped ticking, and the
  /// motors are off as far as this can be known.
  virtual Status status() const = 0;
};

/// A device on a simulated clock that starts at 0: it ticks on request.
class SteppedDevice : public HapticDevice {
 public:
  /// Computes the next tick, as fast as possible. False: there are no more ticks.
  virtual bool step() = 0;
};

// The handle of a device that a browser page moves: by pointer, keys or gamepad.

/// Identifies a page; any number except 0.
using PageNumber = std::uint64_t;

/// Carries poses from a page to the device. One page holds the handle at a time. All calls except
/// newest() come from one thread; nobody waits for it, and it never waits. Times: s, monotonic.
class PageHandle {
 public:
  static constexpr double kFastest = 3;       ///< m/s, limit for the poses of a page
  static constexpr double kFastestTurn = 30;  ///< rad/s
  static constexpr double kFarthest = 100;    ///< m
  /// Poses arrive in bursts if a network or a page is busy, s.
  static constexpr double kBunch = 0.1;
  /// After this time without a pose, another page may take the handle, s.
  static constexpr double kPatience = 5;

  /// Update for the device.
  struct Update {
    std::uint64_t grip = 0;  ///< counter: the first pose of each grip is a reference
    bool is_held = false;
    double time = 0;  ///< s, when the pose arrived
    Pose X_BH;
  };

  PageHandle();
  ~PageHandle();

  /// Takes the handle for `page`. Error: another page holds it.
  Status hold(PageNumber page, double now);
  /// The first pose after hold() is the reference for the current pose of the handle, and moves
  /// nothing; differences of later poses move the handle, in B. Errors: `page` does not hold it;
  /// not a pose, or one that no hand can reach in this time. Then the handle stays.
  Status move(PageNumber page, const Pose& X_BH, double now);
  /// The next pose is again the reference for the current pose of the handle.
  void grip_anew() { ++grip_; }
  /// No effect if `page` does not hold it.
  void release(PageNumber page);

  bool is_held() const { return holder_ != 0; }
  /// The limits of a device that is only displayed: soft enough to see the spring.
  static DeviceLimits limits();

  /// Device's thread: the newest update, or null if there is none. Valid until the next call.
  const Update* newest() noexcept;

 private:
  struct Mailbox;
  Status check(const Pose& X_BH, double now) const;

  PageNumber holder_ = 0;
  std::uint64_t grip_ = 0, sent_grip_ = 0;
  double last_time_ = 0;  // s: time of the last message of the holder
  Pose last_X_BH_;
  std::unique_ptr<Mailbox> mailbox_;
};

}}  // namespace palpate::v0
