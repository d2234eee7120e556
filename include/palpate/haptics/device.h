// A haptic device: where the hand is, and what it is to feel. Who calls whom differs (some drivers
// are asked, some call back from a thread of their own, some answer one message with one), so the
// device keeps the clock and asks for the wrench of each tick.
#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <string>

#include "palpate/core/core.h"
#include "palpate/math/geometry.h"

namespace palpate::inline v0 {

/// What a device can do without harm. SI units.
struct DeviceLimits {
  double max_force = 0;              ///< N
  double max_torque = 0;             ///< N m; 0: the device renders no torque
  double max_stiffness = 0;          ///< N/m
  double max_angular_stiffness = 0;  ///< N m/rad
  double max_damping = 0;            ///< N s/m
  double workspace_radius = 0;       ///< m
  double damping = 0;                ///< N s/m, of the mechanism itself: what makes it passive
  double angular_damping = 0;        ///< N m s/rad
};

struct DeviceInfo {
  std::string kind;  ///< as on the command line: sim, replay, spacenav, haply, ...
  std::string name;  ///< for humans: model and serial number or address
  DeviceLimits limits;
  double rate = 1000;  ///< ticks per second, nominal
  bool senses_orientation = true;
  int num_buttons = 0;
};

/// What is known of the hand at one tick. Base frame B of the device; handle frame H.
struct DeviceState {
  double time = 0;  ///< s, monotonic clock of this computer
  Pose X_BH;
  Twist V_BH;                 ///< of the handle's origin, in B
  std::uint32_t buttons = 0;  ///< bit per button
  bool is_valid = false;      ///< false: the device said nothing usable this time; the rest is old
};

/// The wrench that the hand is to feel from this state on: force and torque at the handle's origin,
/// in B. Called from the device's own thread; it does not throw, allocate, lock or wait.
using DeviceTick = std::function<Wrench(const DeviceState& state)>;

class HapticDevice {
 public:
  virtual ~HapticDevice() = default;  ///< stops

  virtual const DeviceInfo& info() const = 0;
  /// Begins to tick. Errors: the device does not answer, what it said.
  virtual Status start(DeviceTick tick) = 0;
  /// No tick runs or comes any more, and the motors are off. Never waits for more than a second.
  virtual void stop() noexcept = 0;
  /// An error once the device is lost or has refused to go on: it has stopped ticking, and the
  /// motors are off as far as it can be known.
  virtual Status status() const = 0;
};

/// A device on a simulated clock, which begins at 0: it ticks when it is told to.
class SteppedDevice : public HapticDevice {
 public:
  /// The next tick, as fast as it can be computed. False: there is none any more.
  virtual bool step() = 0;
};

// The handle of a device that a page in a browser moves: by pointer, keys or gamepad.

/// Which page; any number but 0.
using PageNumber = std::uint64_t;

/// From a page to the device. One page holds the handle at a time. All calls but heard() come from
/// one thread, which is never waited for and does not wait. Times are s, monotonic.
class PageHandle {
 public:
  static constexpr double kFastest = 3;       ///< m/s, of the poses that a page tells
  static constexpr double kFastestTurn = 30;  ///< rad/s
  static constexpr double kFarthest = 100;    ///< m
  /// Poses come in bunches where a network or a page is busy, s.
  static constexpr double kBunch = 0.1;
  /// Who has told no pose for so long can be relieved by another page, s.
  static constexpr double kPatience = 5;

  /// What the device is told.
  struct News {
    std::uint64_t grip = 0;  ///< counts: the first pose of each is where the handle is already
    bool is_held = false;
    double time = 0;  ///< when the pose came
    Pose X_BH;
  };

  PageHandle();
  ~PageHandle();

  /// Error: another page holds it.
  Status hold(PageNumber page, double now);
  /// The first pose after hold() stands for where the handle is then, and moves nothing; what later
  /// ones differ from it the handle moves, in B. Errors: `page` does not hold it; no pose, or one
  /// that no hand can have come to since the last one. The handle then stays where it is.
  Status move(PageNumber page, const Pose& X_BH, double now);
  /// The next pose stands for where the handle is then, again.
  void grip_anew() { ++grip_; }
  /// Nothing if `page` does not hold it.
  void let_go(PageNumber page);

  bool is_held() const { return holder_ != 0; }
  /// The limits of a device that is only seen: as soft as a spring has to be for that.
  static DeviceLimits limits();

  /// The device's thread: the newest if there is news, else null. Valid until the next call.
  const News* heard() noexcept;

 private:
  struct Mailbox;
  Status check(const Pose& X_BH, double now) const;

  PageNumber holder_ = 0;
  std::uint64_t grip_ = 0, told_grip_ = 0;
  double last_time_ = 0;  // s: when the holder was last heard of
  Pose last_X_BH_;
  std::unique_ptr<Mailbox> mailbox_;
};

}  // namespace palpate::inline v0
