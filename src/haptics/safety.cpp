#include "palpate/haptics/safety.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "src/math/internal/matrix6.h"
#include "src/math/internal/rotation_vector.h"

namespace palpate { inline namespace v0 {
namespace {

/// Longest tick that the slew limit counts, s: a late tick makes no leap.
constexpr double kLongestCountedTick = 0.005;
/// Duration of a tick at which the clock stands still, s.
constexpr double kLostTick = 1e-3;
/// Share of the tank at which the controller begins. The rest is for a hand that moves faster than
/// it did a moment ago, before the force has come down.
constexpr double kControlledShare = 0.5;
/// Acceleration of a hand, m/s2 and rad/s2: that of 0.2 kg by 10 N.
constexpr double kRise = 50, kTurnRise = 1000;
/// Speed above that of any hand, m/s and rad/s: more is a glitch of the device.
constexpr double kFastestHand = 10, kFastestTurn = 100;
/// Factor that keeps vectors scaled to a limit from being rounded above it.
constexpr double kJustBelow = 1 - 1e-12;

double largest(const Vec3d& v) { return std::max({std::abs(v.x), std::abs(v.y), std::abs(v.z)}); }

/// Returns v, shortened to `limit`; for any finite v, however large.
Vec3d limited(const Vec3d& v, double limit) {
  const double scale = largest(v);
  if (!(scale > 0) || !(limit > 0)) return {};
  const Vec3d unit = v / scale;
  const double length = norm(unit);
  return length > limit / scale ? unit * (limit * kJustBelow / length) : v;
}

/// Returns `from`, moved toward `to` by at most `step`.
Vec3d approached(const Vec3d& from, const Vec3d& to, double step) {
  const Vec3d way = to - from, allowed = limited(way, step);
  return allowed == way ? to : from + allowed;
}

bool is_fresh(double age, double limit) { return std::abs(age) <= limit; }  // false for NaN

Wrench operator*(double s, const Wrench& w) { return {s * w.force, s * w.torque}; }

/// Returns the largest work of a force within dt, J, on a hand that accelerates at `rise`.
double max_given(const Vec3d& force, const Vec3d& velocity, double rise, double dt) {
  return std::max(dot(force, velocity) + rise * dt * norm(force), 0.0) * dt;
}
/// Lowers the force along a motion, and then as a whole, so that this work is at most `rest`.
Vec3d within(const Vec3d& force, const Vec3d& velocity, double rise, double dt, double rest) {
  if (!(max_given(force, velocity, rise, dt) > rest)) return force;
  Vec3d kept = force;
  const double squared = dot(velocity, velocity), power = dot(force, velocity);
  const double allowed = std::max(rest / dt - rise * dt * norm(force), 0.0);
  if (squared > 1e-24 && power > allowed) kept -= velocity * ((power - allowed) / squared);
  const double given = max_given(kept, velocity, rise, dt);
  return given > rest ? kept * (rest / given) : kept;
}
/// Limits the wrench to the energy left in the tank, `rest`. The controller plans for a steady
/// hand, too late for one that the force accelerates; this limit overrides the slew limit. `dt`:
/// age of the hand's pose at the next tick, s, if that comes as soon as this one.
Wrench within_tank(const Wrench& wrench, const Twist& motion, double dt, double rest) {
  if (!(dt > 0)) return wrench;
  const Vec3d force = within(wrench.force, motion.linear, kRise, dt, rest);
  const double left = std::max(rest - max_given(force, motion.linear, kRise, dt), 0.0);
  return {force, within(wrench.torque, motion.angular, kTurnRise, dt, left)};
}

}  // namespace

Wrench SafetyFilter::filter(const Wrench& desired, const SafetyInput& input) noexcept {
  if (!has_ticked_ && std::isfinite(input.time)) {
    last_time_ = last_valid_time_ = input.time;
    has_ticked_ = true;
  }
  const double dt = input.time - last_time_;
  if (std::isfinite(input.time)) last_time_ = input.time;
  if (input.state.is_valid) last_valid_time_ = last_time_;
  observe(input, dt);
  status_.damping = 0;

  step_gate(desired, input, dt);
  // A device that renders no force gets none; the force comes back by the ramp.
  if (!input.state.has_force) return last_ = fade_from_ = {};
  // The energy left in the tank bounds the work of the force.
  const double rest = options_.passivity_control
                          ? std::max(options_.energy_tank - status_.energy, 0.0)
                          : std::numeric_limits<double>::infinity();
  const double unseen = dt + (last_time_ - last_valid_time_);
  if (status_.fault != Fault::none) {
    const double fade = gate_.fade();
    if (!(fade > 0)) return last_ = {};
    last_ = within_tank(fade * fade_from_, seen_motion_, unseen, rest);
    fade_from_ = (1 / fade) * last_;  // a lowered force stays lowered
    return last_;
  }

  const Wrench within = limit(desired);
  // While waiting there is no force, and no damping either.
  const bool is_waiting = status_.state == ForceState::waiting;
  const Wrench scaled = status_.gain * within;
  const Wrench target = limit(is_waiting ? scaled : damp(scaled, dt));
  // While waiting the force falls to zero even if the clock stands still.
  const double slewed = is_waiting && dt == 0 ? kLostTick : dt;
  const Wrench out = within_tank(slew(target, slewed), seen_motion_, unseen, rest);
  const bool was_limited = !(within.force == desired.force) || !(out.force == target.force) ||
                           (limits_.max_torque > 0 && !(within.torque == desired.torque)) ||
                           !(out.torque == target.torque);
  if (was_limited) ++status_.num_limited;
  return last_ = out;
}

Fault SafetyFilter::find_fault(const Wrench& desired, const SafetyInput& input,
                               double dt) const noexcept {
  if (is_stopping_) return Fault::stopped;
  if (input.sensor_failed) return Fault::sensor;
  const DeviceState& state = input.state;
  if (!std::isfinite(input.time) || !is_finite(desired)) return Fault::not_finite;
  if (state.is_valid &&
      !(is_finite(state.X_BH) && is_finite(state.V_BH.linear) && is_finite(state.V_BH.angular))) {
    return Fault::not_finite;
  }
  if (input.backend_failed) return Fault::backend;
  const bool is_patient = gate_.state() == ForceState::waiting;
  if (input.is_suspended || dt < 0 || (!is_patient && dt > options_.max_tick)) return Fault::loop;

  const double silence = last_time_ - last_valid_time_;
  if (silence > (is_patient ? std::max(options_.max_device_silence, options_.engage_timeout)
                            : options_.max_device_silence)) {
    return Fault::device;
  }
  if (!is_patient && !state.has_force) return Fault::device;
  if (!is_patient || gate_.waiting_seconds(last_time_) > options_.engage_timeout) {
    if (!is_fresh(input.contact_age, options_.max_contact_age)) return Fault::stale_contact;
    if (!is_fresh(input.sensor_age, options_.max_sensor_age)) return Fault::stale_sensor;
  }
  if (options_.passivity_control && status_.energy > options_.energy_tank) return Fault::energy;
  return Fault::none;
}

void SafetyFilter::step_gate(const Wrench& desired, const SafetyInput& input, double dt) noexcept {
  const ForceState before = gate_.state();
  const bool is_off = before == ForceState::off || before == ForceState::held_off;
  // The buttons of an invalid state are ignored, too.
  const bool is_known = input.state.is_valid && is_finite(input.state.X_BH);
  const bool is_pressed = is_known && (input.state.buttons & ~last_buttons_ & 1u) != 0;
  if (is_known) last_buttons_ = input.state.buttons;
  // Button 0 requests the force while it is off, and while a free hand is awaited after a fault
  // unless it is the dead-man switch; never while clutched or while the device is not driven.
  const bool can_ask = (is_off || (gate_.waits_after_fault() && !options_.dead_man)) &&
                       input.is_driven && !input.is_clutched;

  ForceGate::Input now;
  now.time = last_time_;
  now.dt = dt;
  now.fault = find_fault(desired, input, dt);
  // A device may leave out a tick now and then: its last state still counts.
  const double silence = last_time_ - last_valid_time_;
  now.is_seen = input.state.is_valid;
  now.is_ready = has_pose_ && input.state.has_force && dt <= options_.max_tick &&
                 silence <= options_.max_device_silence &&
                 is_fresh(input.contact_age, options_.max_contact_age) &&
                 is_fresh(input.sensor_age, options_.max_sensor_age);
  const bool is_turned =
      limits_.max_force > 0 && limits_.max_torque > 0 &&
      norm(desired.torque) * limits_.max_force >= options_.engage_force * limits_.max_torque;
  // A clutched hand feels no force, so a small one does not mean that the tool is free.
  now.is_clutched = input.is_clutched;
  now.is_quiet = !input.is_clutched && input.is_measured &&
                 (input.is_free || (norm(desired.force) < options_.engage_force && !is_turned));
  now.is_permitted = input.is_driven && (!options_.dead_man || (input.state.buttons & 1u) != 0);
  now.is_requested = input.is_requested || (can_ask && is_pressed);
  gate_.step(now);

  if (status_.fault == Fault::none && gate_.fault() != Fault::none) fade_from_ = last_;
  // The energy given to the hand is settled once there is no force.
  const bool has_faded = before == ForceState::fading && gate_.state() != before;
  const bool has_none = gate_.state() == ForceState::waiting && largest(last_.force) == 0 &&
                        largest(last_.torque) == 0;
  if (has_faded || has_none) status_.energy = 0;
  status_.state = gate_.state();
  status_.fault = gate_.fault();
  status_.fault_time = gate_.fault_time();
  status_.num_faults = gate_.num_faults();
  status_.gain = gate_.gain();
}

/// Counts the energy given to the hand. The force was constant between the ticks, so its work is
/// force times displacement, without any velocity estimate. Energy from the hand counts up to the
/// stored one; the rest is lost. As that only raises the sum, which stays below the tank, the hand
/// gets no more than the tank and the stored energy after any tick.
void SafetyFilter::observe(const SafetyInput& input, double dt) noexcept {
  motion_ = {};
  if (input.state.is_valid && is_finite(input.state.X_BH)) count_work(input.state.X_BH, dt);
  const double stored = std::isfinite(input.stored) ? std::max(input.stored, 0.0) : 0;
  status_.energy = std::max(status_.energy, -stored);
}

void SafetyFilter::count_work(const Pose& X_BH, double dt) noexcept {
  if (has_pose_ && dt > 0) {
    const Vec3d way = limited(X_BH.translation - last_X_BH_.translation, kFastestHand * dt);
    const Vec3d turn =
        limited(rotation_between(normalized(last_X_BH_.rotation), normalized(X_BH.rotation)),
                kFastestTurn * dt);
    const double given = dot(last_.force, way) + dot(last_.torque, turn);
    if (std::isfinite(given)) {  // else not the motion of a hand
      status_.energy += given;
      seen_motion_ = motion_ = {way / dt, turn / dt};
    }
  }
  last_X_BH_ = X_BH;
  has_pose_ = true;
}

Wrench SafetyFilter::limit(const Wrench& wrench) const noexcept {
  return {limited(wrench.force, options_.force_share * limits_.max_force),
          limited(wrench.torque, options_.force_share * limits_.max_torque)};
}

/// Passivity controller (Hannaford and Ryu 2002). While a force goes down from f to zero at the
/// slew limit S, a hand that moves along at v is given v (f T + f^2 / (2 S)). If the tank's share
/// does not hold that, the force along the motion is lowered to the f for which it does; once the
/// share is overdrawn, damping takes energy back, as much as the device can bear.
Wrench SafetyFilter::damp(const Wrench& wrench, double dt) noexcept {
  if (!options_.passivity_control || !(dt > 0)) return wrench;
  const double speed = norm(motion_.linear);
  const double turning_power = dot(wrench.torque, motion_.angular);
  const double along = speed > 0 ? dot(wrench.force, motion_.linear) / speed : 0;
  const double rest = kControlledShare * options_.energy_tank - status_.energy;

  const double stopping = std::max(along, 0.0);
  const double given = speed * stopping * (dt + stopping / (2 * options_.max_slew));
  const double turned = std::max(turning_power, 0.0) * dt;
  if (given + turned <= rest) return wrench;

  Wrench damped = wrench;
  if (turning_power > 0) {
    const double squared = dot(motion_.angular, motion_.angular);
    damped.torque = damped.torque - motion_.angular * (turning_power / squared);
  }
  if (!(speed > 0)) return damped;
  const double s = options_.max_slew;
  const double allowed =
      rest > 0 ? std::min(s * (std::sqrt(dt * dt + 2 * rest / (s * speed)) - dt), stopping)
               : -std::min(limits_.max_damping * speed, -rest / (speed * dt));
  if (along <= allowed) return damped;
  status_.damping = (along - allowed) / speed;
  damped.force = damped.force - motion_.linear * status_.damping;
  return damped;
}

Wrench SafetyFilter::slew(const Wrench& wrench, double dt) const noexcept {
  const double counted = std::min(dt, kLongestCountedTick);
  return {approached(last_.force, wrench.force, options_.max_slew * counted),
          approached(last_.torque, wrench.torque, options_.max_torque_slew * counted)};
}

}}  // namespace palpate::v0
