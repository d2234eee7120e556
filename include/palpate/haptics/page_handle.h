// The handle of a device that a page in a browser moves: by pointer, keys or gamepad.
#pragma once

#include <cstdint>
#include <memory>

#include "palpate/haptics/device.h"

namespace palpate {

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

}  // namespace palpate
