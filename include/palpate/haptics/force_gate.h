// When the hand is given a force: the state machine of faults and of recovery from them. Its
// picture is in docs/guide/haptics.md.
#pragma once

#include <cstdint>
#include <string_view>

#include "palpate/haptics/state_numbers.h"
#include "palpate/settings/setting_table.h"

namespace palpate {

/// Why there is no force.
enum class Fault : std::uint8_t {
  none,
  // Passing ones: the force comes back by itself.
  not_finite,     ///< a wrench or a state that is no number
  stale_contact,  ///< no fresh contact within the limit
  stale_sensor,   ///< no fresh depth frame within the limit
  device,         ///< the device gave no usable state within the limit
  loop,           ///< ticks came too late
  backend,        ///< the contact query failed (StepStatus::backend_failed)
  energy,         ///< the passivity controller ran out of damping
  // Lasting ones: the run ends.
  sensor,   ///< the source of depth frames has failed for good
  stopped,  ///< asked for
};
constexpr auto names_of(Fault) {
  return std::array{"none", "not_finite", "stale_contact", "stale_sensor", "device",
                    "loop", "backend",    "energy",        "sensor",       "stopped"};
}
constexpr bool is_lasting(Fault fault) { return fault >= Fault::sensor; }
std::string_view describe(Fault fault);  ///< one sentence: what happened and what to do

enum class ForceState : std::uint8_t {
  waiting,   ///< no force: for fresh measurements and a hand that is free of contact
  engaged,   ///< the force: by the ramp from none to all of it
  fading,    ///< a fault: from the force that there was to none
  off,       ///< no force: until all has been well for a while
  held_off,  ///< no force after too many faults: until somebody asks for it
  ended,     ///< no force any more
};
constexpr auto names_of(ForceState) {
  return std::array{"waiting", "engaged", "fading", "off", "held_off", "ended"};
}

struct ForceGateOptions {
  double ramp_seconds = 0.5;  ///< from no force to all of it after engaging
  /// Engages only when the tool has touched nothing, or the wanted force has been below this, for
  /// `engage_ticks`; a hand that begins inside something is let in by the ramp after
  /// `engage_timeout` instead, but not after a fault.
  double engage_force = 0.2;  ///< N
  int engage_ticks = 10;
  double engage_timeout = 2;     ///< s
  double fade_seconds = 0.05;    ///< from any force to zero after a fault
  double recover_seconds = 0.5;  ///< all has to be well that long after a fault
  /// After this many returns of the force within a minute it stays off until it is asked for.
  int max_recoveries = 10;
};

/// One per safety filter. No allocation, no throw; O(1).
class ForceGate {
 public:
  explicit ForceGate(const ForceGateOptions& options)
      : options_(options), budget_(options.max_recoveries) {}

  /// What is known at a tick.
  struct Input {
    double time = 0;            ///< s; does not run backwards
    double dt = 0;              ///< s since the last tick
    Fault fault = Fault::none;  ///< what is wrong
    bool is_ready = false;      ///< all that a force rests on is there and fresh
    bool is_quiet = false;      ///< the hand is free of contact
    bool is_permitted = true;   ///< false: somebody has let go of the dead-man switch
    bool is_asked_for = false;  ///< somebody wants the force back: also in contact
  };
  void step(const Input& input) noexcept;

  void remember(StateNumbers& numbers) noexcept {
    numbers(state_, fault_, fault_time_, num_faults_, gain_, fade_, fade_gain_, waiting_since_,
            well_since_, budget_, num_quiet_, has_begun_, is_after_fault_, is_asked_for_);
  }

  ForceState state() const noexcept { return state_; }
  /// Why there is no force; none in `waiting` and `engaged`.
  Fault fault() const noexcept { return fault_; }
  /// s: when that began.
  double fault_time() const noexcept { return fault_time_; }
  std::uint32_t num_faults() const noexcept { return num_faults_; }
  /// Share of the wanted force, 0 to 1; in `fading` what is left of it.
  double gain() const noexcept { return gain_; }
  /// In `fading`: share of the wrench that went out when the fault was found, from 1 to 0.
  double fade() const noexcept { return fade_; }
  /// s: how long it has been waiting.
  double waiting_seconds(double time) const noexcept {
    return has_begun_ ? time - waiting_since_ : 0;
  }

 private:
  void fail(Fault fault, double time) noexcept;
  void wait(double time) noexcept;
  void step_waiting(const Input& input) noexcept;
  void step_engaged(const Input& input) noexcept;
  void step_fading(const Input& input) noexcept;
  void step_off(const Input& input) noexcept;

  ForceGateOptions options_;
  ForceState state_ = ForceState::waiting;
  Fault fault_ = Fault::none;
  double fault_time_ = 0;
  std::uint32_t num_faults_ = 0;
  double gain_ = 0, fade_ = 0, fade_gain_ = 0;
  double waiting_since_ = 0, well_since_ = 0;
  double budget_;  // returns of the force that may still come; a minute gives max_recoveries
  int num_quiet_ = 0;
  bool has_begun_ = false, is_after_fault_ = false, is_asked_for_ = false;
};

}  // namespace palpate
