#include "palpate/haptics/safety.h"

#include <algorithm>
#include <numeric>

namespace palpate { inline namespace v0 {
namespace {

/// Longest tick that the ramp counts, s: a late tick makes no leap.
constexpr double kLongestCountedTick = 0.005;
/// Decrease of the fade at a tick without measured time: it ends even if the clock stands still.
constexpr double kFadePerLostTick = 1e-3;
/// The force of a clock that stands still never becomes too old, so it may not stay for longer.
constexpr int kMaxLostTicks = 20;
constexpr double kPart = 5;  // s: returns within a minute are counted in parts

}  // namespace

void ForceGate::step(const Input& input) noexcept {
  if (!has_begun_) wait(input.time);
  has_begun_ = true;
  if (input.dt > 0) age_returns(input.dt);
  is_requested_ = (is_requested_ || input.is_requested) && state_ != ForceState::engaged;
  const bool has_force = state_ == ForceState::waiting || state_ == ForceState::engaged;
  if (input.fault != Fault::none && has_force) return fail(input.fault, input.time);
  // A lasting fault replaces a passing one.
  if (is_lasting(input.fault) && !is_lasting(fault_)) fault_ = input.fault;
  switch (state_) {
    case ForceState::waiting: return step_waiting(input);
    case ForceState::engaged: return step_engaged(input);
    case ForceState::fading: return step_fading(input);
    case ForceState::off:
    case ForceState::held_off: return step_off(input);
    case ForceState::ended: return;
  }
}

void ForceGate::age_returns(double dt) noexcept {
  part_seconds_ += dt;
  if (part_seconds_ >= kNumParts * kPart) {
    returns_.fill(0);
    part_seconds_ = 0;
  }
  for (; part_seconds_ >= kPart; part_seconds_ -= kPart) {
    std::shift_right(returns_.begin(), returns_.end(), 1);
    returns_[0] = 0;
  }
}

/// The tick that finds a fault keeps the previous force, unless the fade takes no time.
void ForceGate::fail(Fault fault, double time) noexcept {
  state_ = ForceState::fading;
  fault_ = fault;
  fault_time_ = time;
  ++num_faults_;
  is_after_fault_ = true;
  is_requested_ = false;  // that was before
  fade_gain_ = gain_;
  fade_ = options_.fade_seconds > 0 ? 1 : 0;
  gain_ = fade_ * fade_gain_;
}

void ForceGate::wait(double time) noexcept {
  state_ = ForceState::waiting;
  fault_ = Fault::none;
  gain_ = 0;
  num_quiet_ = 0;
  waiting_since_ = time;
}

void ForceGate::step_waiting(const Input& input) noexcept {
  if (!input.is_permitted) return wait(input.time);
  if (!input.is_ready) num_quiet_ = 0;
  if (input.is_ready && input.is_seen) num_quiet_ = input.is_quiet ? num_quiet_ + 1 : 0;
  const bool has_waited =
      !is_after_fault_ && waiting_seconds(input.time) >= options_.engage_timeout;
  if (!input.is_ready || !(num_quiet_ >= options_.engage_ticks || has_waited || is_requested_)) {
    return;
  }
  if (is_after_fault_) ++returns_[0];
  is_after_fault_ = is_requested_ = false;
  state_ = ForceState::engaged;
  num_quiet_ = 0;
  gain_ = options_.ramp_seconds > 0 ? 0 : 1;
}

void ForceGate::step_engaged(const Input& input) noexcept {
  num_quiet_ = input.dt > 0 ? 0 : num_quiet_ + 1;
  if (num_quiet_ > kMaxLostTicks) return fail(Fault::loop, input.time);
  if (!input.is_permitted) return wait(input.time);
  if (!(options_.ramp_seconds > 0)) return;
  if (input.is_clutched) {
    gain_ = 0;
    return;
  }
  const double rise = std::min(input.dt, kLongestCountedTick) / options_.ramp_seconds;
  gain_ = std::min(gain_ + rise, 1.0);
}

void ForceGate::step_fading(const Input& input) noexcept {
  fade_ -= input.dt > 0 ? input.dt / options_.fade_seconds : kFadePerLostTick;
  if (!(fade_ > 1e-9)) fade_ = 0;
  gain_ = fade_ * fade_gain_;
  if (fade_ > 0) return;
  state_ = is_lasting(fault_) ? ForceState::ended : ForceState::off;
  well_since_ = input.time;
}

void ForceGate::step_off(const Input& input) noexcept {
  if (is_lasting(fault_)) {
    state_ = ForceState::ended;
    return;
  }
  if (input.fault != Fault::none || input.time < well_since_) well_since_ = input.time;
  if (is_requested_) {
    state_ = ForceState::off;
    returns_.fill(0);
  } else if (std::accumulate(returns_.begin(), returns_.end(), 0) >= options_.max_recoveries) {
    state_ = ForceState::held_off;
  }
  const bool is_well =
      input.fault == Fault::none && input.time - well_since_ >= options_.recover_seconds;
  if (state_ == ForceState::off && is_well) wait(input.time);
}

}}  // namespace palpate::v0
