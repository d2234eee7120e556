// The tick that runs in the thread of the OpenHaptics driver, once per callback.
#pragma once

#include <atomic>
#include <memory>

#include "palpate/haptics/device.h"
#include "src/devices/motor_wrench.h"
#include "src/devices/open_haptics/open_haptics_api.h"
#include "src/devices/transport/tick_door.h"

namespace palpate { inline namespace v0 {

/// One run of one device, from start to stop. The driver's thread calls `call_back`; everything
/// else may be called from any thread.
class OpenHapticsServo {
 public:
  OpenHapticsServo(const OpenHapticsApi& api, HdHandle device, const DeviceInfo& info,
                   DeviceTick tick);

  /// Callback to be scheduled, with the servo as its data. No allocation, no wait. After an error
  /// one more call takes the force away; only one frame is allowed per call. The last call sends no
  /// force and returns "done".
  static unsigned call_back(void* servo) noexcept;

  /// The next call is the last one.
  void request_end() noexcept { wants_end_.store(true, std::memory_order_release); }
  /// No tick runs or starts any more, whenever the driver calls again. Until that call is over, it
  /// keeps `self`, which is this servo.
  void give_up(std::shared_ptr<OpenHapticsServo> self) noexcept;
  /// Called by the driver's thread after the last callback; it may not touch the servo afterwards.
  void end() noexcept;
  bool has_ended() const noexcept { return life_.load() == Life::ended; }
  /// True even if it has ended since.
  bool is_given_up() const noexcept { return door_.is_closed(); }
  /// Time of the newest callback, s; 0 before the first one.
  double last_time() const noexcept { return last_time_.load(std::memory_order_acquire); }
  /// The error that ended it; 0: none.
  HdEnum failure() const noexcept { return failure_.load(std::memory_order_acquire); }

 private:
  unsigned frame() noexcept;
  void read() noexcept;
  void write(const Wrench& F_H_B) noexcept;
  /// Decides on an error: force errors pause the force; many in a row or any other error end it.
  void judge(HdEnum code) noexcept;

  const OpenHapticsApi api_;
  const HdHandle device_;
  const DeviceLimits limits_;
  const bool senses_orientation_;
  DeviceTick tick_;
  DeviceState state_;
  MotorRamp ramp_;
  TickDoor door_;
  int rest_ = 0;          // ticks without force to come
  int num_weary_ = 0;     // ticks without force so far
  int num_unusable_ = 0;  // states in a row
  std::atomic<bool> wants_end_ = false;
  enum class Life { running, given_up, ended };
  std::atomic<Life> life_ = Life::running;
  std::shared_ptr<OpenHapticsServo> self_;  // while it is given up
  std::atomic<double> last_time_ = 0;
  std::atomic<HdEnum> failure_ = 0;
};

}}  // namespace palpate::v0
