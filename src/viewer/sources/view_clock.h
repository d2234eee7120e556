// The clock of playback: follows the wall clock at a factor, or is paused.
#pragma once

#include <algorithm>

#include "src/core/internal/monotonic_clock.h"

namespace palpate { inline namespace v0 {

/// Clock of playback. One thread at a time.
class ViewClock {
 public:
  static constexpr double kSlowest = 0.01, kFastest = 10;

  double now() const {
    return is_paused_ ? position_ : position_ + speed_ * (monotonic_now() - since_);
  }
  bool is_paused() const { return is_paused_; }
  double speed() const { return speed_; }

  void set(double time) {
    position_ = time;
    since_ = monotonic_now();
  }
  void set_speed(double speed) {
    set(now());
    speed_ = std::clamp(speed, kSlowest, kFastest);
  }
  void pause() {
    set(now());
    is_paused_ = true;
  }
  void resume() {
    set(now());
    is_paused_ = false;
  }

 private:
  double position_ = 0, since_ = monotonic_now();
  double speed_ = 1;
  bool is_paused_ = false;
};

}}  // namespace palpate::v0
