// A hand that feels a device's force through the safety filter, as in a run.
#pragma once

#include <algorithm>
#include <functional>
#include <limits>
#include <mutex>

#include <gtest/gtest.h>

#include "palpate/haptics/safety.h"
#include "tests/devices/tick_log.h"

namespace palpate::test {

class FilteredHand {
 public:
  static constexpr double kSilence = 0.05, kFade = 0.05;  // s

  explicit FilteredHand(const DeviceLimits& limits)
      : filter_(SafetyFilter::create(limits, options()).value()) {}

  DeviceTick tick() {
    return [this](const DeviceState& state) {
      const std::lock_guard lock(mutex_);
      SafetyInput input;
      input.time = state.time;
      input.state = state;
      input.is_free = true;  // it engages at once
      last_ = filter_.filter({{0, 0, 1}, {}}, input);
      if (state.is_valid) valid_time_ = state.time;
      const bool is_late = state.time > valid_time_ + kSilence;
      late_since_ = is_late ? std::min(late_since_, state.time) : kNever;
      num_after_fade_ += state.time > late_since_ + 2 * kFade && norm(last_.force) > 0 ? 1 : 0;
      return last_;
    };
  }
  bool has_force() const {
    const std::lock_guard lock(mutex_);
    return norm(last_.force) > 0.5;
  }
  bool has_faded() const {
    const std::lock_guard lock(mutex_);
    return filter_.status().fault == Fault::device && norm(last_.force) == 0;
  }
  /// Ticks with a force long after the last usable state.
  int num_after_fade() const {
    const std::lock_guard lock(mutex_);
    return num_after_fade_;
  }

 private:
  /// All limits but that of the device's silence are such that no busy machine reaches them.
  static SafetyOptions options() {
    SafetyOptions options;
    options.max_device_silence = kSilence;
    options.fade_seconds = kFade;
    options.max_tick = 60;
    options.ramp_seconds = options.recover_seconds = 0.01;
    options.max_recoveries = 1000;
    options.passivity_control = false;
    return options;
  }

  mutable std::mutex mutex_;
  SafetyFilter filter_;
  Wrench last_;
  static constexpr double kNever = std::numeric_limits<double>::infinity();
  double valid_time_ = 0, late_since_ = kNever;
  int num_after_fade_ = 0;
};

/// While a server stands still the force fades; when it goes on, so does the device, and the force
/// returns. On a busy machine the device may be lost meanwhile, for which a second is enough: then
/// all is tried again.
inline void expect_to_fade_and_return(HapticDevice& device,
                                      const std::function<void(bool)>& stand_still) {
  FilteredHand hand(device.info().limits);
  const auto comes_to = [&](bool (FilteredHand::*what)() const) {
    return eventually([&] { return (hand.*what)() || !device.status(); }) && device.status();
  };
  bool has_returned = false, was_lost = true;
  for (int i = 0; i < 10 && was_lost; ++i) {
    if (!device.start(hand.tick())) continue;
    const bool has_come = comes_to(&FilteredHand::has_force);
    stand_still(true);
    const bool has_faded = has_come && comes_to(&FilteredHand::has_faded);
    stand_still(false);
    has_returned = has_faded && comes_to(&FilteredHand::has_force);
    was_lost = !device.status();
  }
  device.stop();
  EXPECT_TRUE(has_returned);
  EXPECT_EQ(hand.num_after_fade(), 0);
}

}  // namespace palpate::test
