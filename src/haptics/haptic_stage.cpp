#include "src/haptics/haptic_stage.h"

#include <algorithm>
#include <utility>

#include "src/core/monotonic_clock.h"
#include "src/haptics/real_time.h"

namespace palpate {
namespace {

constexpr int kPriority = 80;
constexpr std::size_t kNumRecords = 4096;  // four seconds at 1 kHz

std::int64_t nanoseconds(double seconds) { return static_cast<std::int64_t>(1e9 * seconds); }

}  // namespace

HapticStage::HapticStage(std::unique_ptr<Coupling> coupling, SafetyFilter safety,
                         SurfaceStage& surfaces, ContactStage& contacts, const Settings& settings,
                         LoopTimes& times)
    : surfaces_(surfaces),
      contacts_(contacts),
      settings_(settings),
      times_(times),
      coupling_(std::move(coupling)),
      safety_(std::move(safety)),
      records_(settings.keeps_records ? kNumRecords : 0) {}

Wrench HapticStage::tick(const DeviceState& state) noexcept {
  const TickStart start{monotonic_now(), thread_cpu_now()};
  if (num_ticks_.load(std::memory_order_relaxed) == 0) {
    first_tick_ = state.time;
    if (settings_.wants_real_time) real_time_error_.store(ask_for_real_time(kPriority));
  }
  const KnownContact& known = contacts_.newest();
  HapticRecord& record = newest_.draft();
  record.revision = revision_;
  record.number = num_ticks_.load(std::memory_order_relaxed);
  record.device = state;
  record.dt = step_seconds(state);
  record.step = record.dt > 0 ? coupling_->step(state, known.contact, record.dt) : CouplingStep{};
  if (has_tool_) contacts_.move_tool({state.time, record.step.X_WT});

  const bool has_contact = known.number > 0;
  record.time = state.time - start_time_.load(std::memory_order_relaxed);
  record.volume = known.contact.volume;
  record.contact_age = state.time - (has_contact ? known.contact.time : first_tick_);
  record.sensor_age = state.time - (has_contact ? known.capture_time : first_tick_);
  record.contact_number = known.number;
  record.frame_number = known.frame_number;

  if (wants_stop_.load(std::memory_order_acquire) || surfaces_.has_source_ended()) {
    if (safety_.status().fault == Fault::none) safety_.stop();
    is_stopping_ = true;
  }
  SafetyInput input{state.time, state, record.contact_age, record.sensor_age, false};
  record.is_stopping = is_stopping_;
  record.has_sensor_failed = surfaces_.has_source_failed();
  record.has_backend_failed = contacts_.has_backend_failed() || surfaces_.has_backend_failed();
  if (record.has_sensor_failed) input.sensor_age = kLostSensorAge;
  input.backend_failed = record.has_backend_failed;
  record.F_H_B = safety_.filter(record.step.F_H_B, input);
  record.safety = safety_.status();

  const Wrench felt = record.F_H_B;
  take_change();
  keep_time(start, record);
  return felt;
}

/// The hand moves the tool, from the first usable state on; until then 0.
double HapticStage::step_seconds(const DeviceState& state) noexcept {
  if (!has_tool_) {
    if (!state.is_valid) return 0;
    coupling_->reset(state);
    has_tool_ = true;
    last_state_time_ = state.time - settings_.tick_seconds;
  }
  // A late tick is a longer step, but not one without bounds.
  const double dt = std::clamp(state.time - last_state_time_, settings_.tick_seconds / 10,
                               10 * settings_.tick_seconds);
  last_state_time_ = state.time;
  return dt;
}

/// For the next tick.
void HapticStage::take_change() noexcept {
  HapticChange* const change = changes_.look();
  if (change == nullptr) return;
  revision_ = change->revision;
  if (change->coupling) {
    if (has_tool_) change->coupling->take_over(coupling_->state());
    std::swap(coupling_, change->coupling);
  }
  changes_.settle();
}

/// Statistics, and the record on its way to the others.
void HapticStage::keep_time(const TickStart& start, const HapticRecord& record) noexcept {
  if (record.safety.fault != Fault::none) {
    fault_.store(record.safety.fault, std::memory_order_relaxed);
    if (record.safety.gain <= 0) has_faded_.store(true, std::memory_order_release);
  }
  const std::uint64_t number = num_ticks_.load(std::memory_order_relaxed);
  if (number > 0) times_.haptic_period.record(nanoseconds(start.time - last_begin_));
  last_begin_ = start.time;
  if (record.contact_number > 0) {
    times_.contact_age.record(nanoseconds(record.contact_age));
    times_.sensor_to_force.record(nanoseconds(record.sensor_age));
  }
  const double computed = thread_cpu_now() - start.cpu, took = monotonic_now() - start.time;
  newest_.draft().compute_nanoseconds = nanoseconds(took);
  times_.haptic_compute.record(nanoseconds(took));
  times_.haptic_cpu.record(nanoseconds(computed));
  if (took > settings_.tick_seconds) num_missed_.fetch_add(1, std::memory_order_relaxed);
  if (settings_.keeps_records) records_.push(newest_.draft());
  newest_.publish();
  num_ticks_.store(number + 1, std::memory_order_release);
}

bool HapticStage::latest(HapticRecord& record) noexcept {
  if (!newest_.refresh()) return false;
  record = newest_.value();
  return true;
}

}  // namespace palpate
