#include "src/run/loop/haptic_stage.h"

#include <algorithm>
#include <utility>

#include "src/core/internal/monotonic_clock.h"
#include "src/run/internal/real_time.h"

namespace palpate { inline namespace v0 {
namespace {

constexpr int kPriority = 80;
constexpr std::size_t kNumRecords = 8192;  // eight seconds at 1 kHz
constexpr std::size_t kNumSnapshots = 16;

/// Returns s in ns; 0 if out of range, as from a device with a broken clock.
std::int64_t nanoseconds(double seconds) {
  constexpr double kMax = 9e18;
  const double number = 1e9 * seconds;
  return number > -kMax && number < kMax ? static_cast<std::int64_t>(number) : 0;
}

}  // namespace

HapticStage::HapticStage(HandPart hand, SurfaceStage& surfaces, ContactStage& contacts,
                         const Settings& settings, LoopTimes& times)
    : surfaces_(surfaces),
      contacts_(contacts),
      settings_(settings),
      times_(times),
      hand_(std::move(hand)),
      records_(settings.keeps_records ? kNumRecords : 0),
      snapshots_(settings.keeps_records ? kNumSnapshots : 0) {}

Wrench HapticStage::tick(const DeviceState& state) noexcept {
  const TickStart start{monotonic_now(), thread_cpu_now()};
  if (hand_.num_ticks() == 0 && settings_.wants_real_time) {
    real_time_error_.store(request_real_time(kPriority));
  }
  TickFlags flags;
  flags.is_stopping = wants_stop_.load(std::memory_order_acquire) || surfaces_.has_source_ended();
  flags.is_force_requested = wants_force_.exchange(false, std::memory_order_acq_rel);
  flags.is_suspended = is_suspended_.load(std::memory_order_acquire);
  flags.has_sensor_failed = surfaces_.has_source_failed();
  flags.has_backend_failed = contacts_.has_backend_failed() || surfaces_.has_backend_failed();
  if (settings_.keeps_records && is_snapshot_due(hand_.num_ticks(), settings_.tick_seconds)) {
    snapshots_.push(hand_.snapshot());
  }
  TickRecord& record = newest_.draft();
  hand_.tick(state, contacts_.newest(), flags, record);
  if (hand_.has_tool()) {
    contacts_.move_tool({state.time, record.step.X_WT});
    surfaces_.move_tool(record.step.X_WT);
  }
  const Wrench F_H_B = record.F_H_B;
  const bool is_without = flags.is_suspended && F_H_B.force == Vec3d{} && F_H_B.torque == Vec3d{};
  const int num_without = num_without_force_.load(std::memory_order_relaxed);
  num_without_force_.store(is_without ? std::min(num_without + 1, 2) : 0,
                           std::memory_order_release);
  if (HapticChange* const change = changes_.look()) {
    hand_.change(change->revision, change->coupling);
    changes_.settle();
  }
  keep_time(start, record);
  return F_H_B;
}

/// Updates the statistics and publishes the record.
void HapticStage::keep_time(const TickStart& start, const TickRecord& record) noexcept {
  num_faults_.store(record.safety.num_faults, std::memory_order_relaxed);
  if (is_lasting(record.safety.fault)) {
    fault_.store(record.safety.fault, std::memory_order_relaxed);
    if (record.safety.gain <= 0 && record.F_H_B.force == Vec3d{} &&
        record.F_H_B.torque == Vec3d{}) {
      has_faded_.store(true, std::memory_order_release);
    }
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

std::optional<TickRecord> HapticStage::latest() noexcept {
  if (!newest_.refresh()) return std::nullopt;
  return newest_.value();
}

}}  // namespace palpate::v0
