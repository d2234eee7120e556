// The safety filter: the only way to a motor. Its output is finite, within the device's limits, has
// no upward jumps, and fades to zero when anything is wrong.
#pragma once

#include <array>
#include <cstdint>
#include <string_view>

#include "palpate/haptics/device.h"
#include "palpate/haptics/local_contact.h"
#include "palpate/settings/setting_table.h"

namespace palpate { inline namespace v0 {

// The state machine of faults and recovery: decides when the hand gets a force.
// docs/reference/haptics.md has the diagram.

/// Reason for no force.
enum class Fault : std::uint8_t {
  none,
  // Temporary faults: the force returns by itself.
  not_finite,     ///< a wrench or a state is not finite
  stale_contact,  ///< no fresh contact within the limit
  stale_sensor,   ///< no fresh depth frame within the limit
  device,         ///< the device gave no usable state within the limit, or took its force away
  loop,           ///< ticks were too late
  backend,        ///< the contact query failed (StepStatus::backend_failed)
  energy,         ///< the passivity controller ran out of damping
  // Permanent faults: the run ends.
  sensor,   ///< the source of depth frames has failed permanently
  stopped,  ///< requested by stop()
};
constexpr auto names_of(Fault) {
  return std::array{"none", "not_finite", "stale_contact", "stale_sensor", "device",
                    "loop", "backend",    "energy",        "sensor",       "stopped"};
}
constexpr bool is_lasting(Fault fault) { return fault >= Fault::sensor; }
std::string_view describe(Fault fault);  ///< one sentence: what happened and what to do

enum class ForceState : std::uint8_t {
  waiting,   ///< no force: waits for fresh measurements and a hand free of contact
  engaged,   ///< force on; the ramp raises it from zero
  fading,    ///< a fault: the force fades to zero
  off,       ///< no force until all has been well for a while
  held_off,  ///< no force after too many returns, until it is requested
  ended,     ///< no force anymore
};
constexpr auto names_of(ForceState) {
  return std::array{"waiting", "engaged", "fading", "off", "held_off", "ended"};
}

/// When the force engages, how it fades, and how it returns after a fault.
struct ForceGateOptions {
  double ramp_seconds = 0.5;  ///< from zero to full force after engaging
  /// Engages only if the tool had no contact, or the desired force was below this (and the torque
  /// below the same share of the device's limit), for `engage_ticks` ticks. Ticks without a state
  /// do not count, and ticks without a measured contact are not free of contact. A hand that starts
  /// in contact gets the ramp after `engage_timeout` instead, but not after a fault.
  double engage_force = 0.2;  ///< N
  int engage_ticks = 10;
  double engage_timeout = 2;     ///< s
  double fade_seconds = 0.05;    ///< from any force to zero after a fault
  double recover_seconds = 0.5;  ///< time without any fault before the force returns
  /// After this many recoveries within a minute, the force stays off until requested.
  int max_recoveries = 10;
};

/// One per safety filter. No allocation, no throw; O(1).
class ForceGate {
 public:
  explicit ForceGate(const ForceGateOptions& options) : options_(options) {}

  /// Inputs at one tick.
  struct Input {
    double time = 0;            ///< s; must not decrease
    double dt = 0;              ///< s since the last tick
    Fault fault = Fault::none;  ///< the current fault
    bool is_ready = false;      ///< all inputs of a force are there and fresh
    bool is_seen = true;        ///< the device gave a state; else is_quiet is ignored
    bool is_quiet = false;      ///< the hand is free of contact
    bool is_permitted = true;   ///< false: the dead-man switch is released
    bool is_requested = false;  ///< the user requests the force: also in contact
    bool is_clutched = false;   ///< no tool in the hand: the ramp starts afterwards
  };
  void step(const Input& input) noexcept;

  ForceState state() const noexcept { return state_; }
  /// Reason for no force; none in `waiting` and `engaged`.
  Fault fault() const noexcept { return fault_; }
  /// s: start of the fault.
  double fault_time() const noexcept { return fault_time_; }
  std::uint32_t num_faults() const noexcept { return num_faults_; }
  /// True if the force, off after a fault, waits for a hand free of contact.
  bool waits_after_fault() const noexcept {
    return state_ == ForceState::waiting && is_after_fault_;
  }
  /// Share of the desired force, 0 to 1; in `fading` the remaining share.
  double gain() const noexcept { return gain_; }
  /// In `fading`: share of the wrench at the start of the fault, from 1 to 0.
  double fade() const noexcept { return fade_; }
  /// s: time in `waiting`.
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
  void age_returns(double dt) noexcept;

  ForceGateOptions options_;
  ForceState state_ = ForceState::waiting;
  Fault fault_ = Fault::none;
  double fault_time_ = 0;
  std::uint32_t num_faults_ = 0;
  double gain_ = 0, fade_ = 0, fade_gain_ = 0;
  double waiting_since_ = 0, well_since_ = 0;
  // Returns of the force after faults, in the current part of a minute and in those before:
  // together they cover at least a minute.
  static constexpr int kNumParts = 13;
  std::array<int, kNumParts> returns_{};
  double part_seconds_ = 0;  // of the present part
  int num_quiet_ = 0;  // ticks in a row: free of contact; in `engaged` without any time between
  bool has_begun_ = false, is_after_fault_ = false, is_requested_ = false;
};

/// Options of the safety filter.
struct SafetyOptions : ForceGateOptions {
  double force_share = 1;            ///< output limit, as a share of the device's limits
  double max_slew = 500;             ///< N/s
  double max_torque_slew = 10;       ///< N m/s
  double max_contact_age = 0.02;     ///< s
  double max_sensor_age = 0.5;       ///< s
  double max_device_silence = 0.01;  ///< s without a valid state
  double max_tick = 0.02;            ///< s between ticks
  bool dead_man = false;             ///< force only while button 0 is held
  bool passivity_control = true;
  /// J, energy that may be given to the hand beyond what coupling and contact have stored, from any
  /// moment on. From half of it the controller damps; beyond it the force is shut off.
  double energy_tank = 0.01;
};
inline void add_settings(SettingTable& t, SafetyOptions& o) {
  constexpr double kShort = 1e-6, kLong = 3600;  // s
  t.section("safety");
  t.add("force_share", o.force_share, {0, 1}, "output limit, as a share of the device's limits");
  t.add("max_slew", o.max_slew, {1e-6, 1e7, "N/s"},
        "maximum rate of the force; it drops at once if it would empty energy_tank");
  t.add("max_torque_slew", o.max_torque_slew, {1e-6, 1e7, "N m/s"}, "maximum rate of the torque");
  t.add("ramp_seconds", o.ramp_seconds, {0, kLong, "s"}, "from zero to full force");
  t.add("engage_force", o.engage_force, {0, 1e4, "N"},
        "the force engages once the desired force is below this");
  t.add("engage_ticks", o.engage_ticks, {1, 1e6, "ticks"}, "consecutive ticks below engage_force");
  t.add("engage_timeout", o.engage_timeout, {0, kLong, "s"},
        "after this, a hand that starts in contact gets the ramp");
  t.add("fade_seconds", o.fade_seconds, {0, 1, "s"}, "from any force to zero after a fault");
  t.add("recover_seconds", o.recover_seconds, {0, kLong, "s"},
        "time without a fault before the force returns");
  t.add("max_recoveries", o.max_recoveries, {0, 1000, "per minute"},
        "recoveries after faults; then the force stays off until requested");
  t.add("max_contact_age", o.max_contact_age, {kShort, kLong, "s"}, "an older contact is a fault");
  t.add("max_sensor_age", o.max_sensor_age, {kShort, kLong, "s"},
        "an older depth frame is a fault");
  t.add("max_device_silence", o.max_device_silence, {kShort, kLong, "s"},
        "a longer time without a usable state is a fault");
  t.add("max_tick", o.max_tick, {kShort, kLong, "s"},
        "a longer time between ticks is a fault; above 1 s also how long a device that does not "
        "tick is waited for");
  t.add("dead_man", o.dead_man, "force only while button 0 is held");
  t.add("passivity_control", o.passivity_control, "adds damping when the hand is given energy");
  t.add("energy_tank", o.energy_tank, {1e-6, 1e3, "J"},
        "energy that may be given to the hand beyond what coupling and contact have stored; "
        "damping from half of it on");
}

/// Inputs of the filter at a tick, in addition to the desired wrench.
struct SafetyInput {
  double time = 0;  ///< s, monotonic
  DeviceState state;
  double contact_age = 0;  ///< s
  double sensor_age = 0;   ///< s
  bool backend_failed = false;
  bool sensor_failed = false;  ///< permanently
  bool is_suspended = false;   ///< the program is about to be suspended: Fault::loop
  bool is_requested = false;   ///< the user requests the force
  bool is_free = false;        ///< the tool has no contact: the wrench only moves the tool
  bool is_measured = true;     ///< false: it is unknown if the tool has contact
  bool is_driven = true;       ///< false: no force, as with a released dead-man switch
  bool is_clutched = false;    ///< the clutch: the force comes by the ramp afterwards
  double stored = 0;           ///< J, energy that the hand may get back: CouplingStep::stored
};

/// State of the safety filter at a tick.
struct SafetyStatus {
  ForceState state = ForceState::waiting;
  Fault fault = Fault::none;     ///< reason for no force
  double fault_time = 0;         ///< s, on the clock of SafetyInput::time: start of the last fault
  std::uint32_t num_faults = 0;  ///< so far
  double gain = 0;               ///< ramp or fade, 0..1
  /// J, passivity observer: net energy given to the hand, but never less than minus the stored one,
  /// as dissipated energy does not come back. Beyond the tank: Fault::energy.
  double energy = 0;
  double damping = 0;             ///< N s/m, of the passivity controller at this tick
  std::uint64_t num_limited = 0;  ///< ticks at which a limit changed the wrench
  /// True if the force is on.
  bool is_engaged() const { return state == ForceState::engaged; }
};

/// One sentence about the change between two ticks, for display; empty if there is none.
std::string_view describe_change(const SafetyStatus& before, const SafetyStatus& after);

/// One per device, one thread at a time. No allocation, no throw; O(1).
///
/// A ForceGate decides when there is a force. While it waits, conditions that would otherwise be
/// faults (no measurement yet, a silent device) only delay the force, for `engage_timeout`. During
/// a fade, the fade sets the rate, not the slew limit. After a fault, a press of button 0 requests
/// the force, unless the clutch holds the tool. If the device has no force, the output is zero.
///
/// From any tick on, the hand is given at most SafetyOptions::energy_tank and the energy stored at
/// that tick (SafetyInput::stored). It gets back the energy that it has put into springs, masses
/// and contacts, but not the energy dissipated by friction and damping.
class SafetyFilter {
 public:
  /// Creates a filter. Errors: options out of range or not finite, limits negative or not finite. A
  /// limit of 0 means that the device renders none.
  static Result<SafetyFilter> create(const DeviceLimits& limits, const SafetyOptions& options);

  /// Returns the safe wrench. Force and torque are limited separately and keep their direction.
  Wrench filter(const Wrench& desired, const SafetyInput& input) noexcept;
  const SafetyStatus& status() const { return status_; }
  /// True once `filter` was called with a finite time.
  bool has_ticked() const noexcept { return has_ticked_; }
  void stop() noexcept { is_stopping_ = true; }  ///< from the next tick on: Fault::stopped

 private:
  SafetyFilter(const DeviceLimits& limits, const SafetyOptions& options)
      : limits_(limits), options_(options), gate_(options) {}

  Fault find_fault(const Wrench& desired, const SafetyInput& input, double dt) const noexcept;
  void observe(const SafetyInput& input, double dt) noexcept;
  void count_work(const Pose& X_BH, double dt) noexcept;
  void step_gate(const Wrench& desired, const SafetyInput& input, double dt) noexcept;
  Wrench limit(const Wrench& wrench) const noexcept;
  Wrench damp(const Wrench& wrench, double dt) noexcept;
  Wrench slew(const Wrench& wrench, double dt) const noexcept;

  DeviceLimits limits_;
  SafetyOptions options_;
  ForceGate gate_;
  SafetyStatus status_;
  Wrench last_;       // output of the last tick
  Wrench fade_from_;  // output at the last fault
  double last_time_ = 0, last_valid_time_ = 0;
  std::uint32_t last_buttons_ = 0;
  Pose last_X_BH_;     // of the last valid state
  Twist motion_;       // of the handle since the tick before, per second; 0 if unknown
  Twist seen_motion_;  // the last known one
  bool has_ticked_ = false, has_pose_ = false, is_stopping_ = false;
};

}}  // namespace palpate::v0
