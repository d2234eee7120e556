#include "palpate/haptics/haptic_loop.h"

#include <algorithm>
#include <atomic>
#include <cmath>
#include <system_error>
#include <thread>
#include <utility>

#include "palpate/core/triple_buffer.h"
#include "src/haptics/bell.h"
#include "src/haptics/contact_stage.h"
#include "src/haptics/real_time.h"
#include "src/haptics/record_queue.h"
#include "src/haptics/surface_stage.h"

namespace palpate {
namespace {

constexpr int kHapticPriority = 80;
constexpr std::size_t kNumRecords = 4096;    // four seconds at 1 kHz
constexpr std::size_t kBatch = 256;          // records given to the observer at a time
constexpr double kPublishingPeriod = 0.005;  // s
constexpr double kFirstTickTimeout = 2;      // s
constexpr double kFadeTimeout = 0.5;         // s, beyond the fade itself

std::int64_t nanoseconds(double seconds) { return static_cast<std::int64_t>(1e9 * seconds); }

Status check(const HapticSettings& settings) {
  if (!(settings.contact_rate >= 1 && settings.contact_rate <= 100000)) {
    return Error{Errc::invalid_argument,
                 "the contact rate must be from 1 to 100000 queries per second; 1000 is usual"};
  }
  if (settings.num_threads < 0 || settings.num_threads > 256) {
    return Error{Errc::invalid_argument,
                 "the number of threads must be from 0 (one per core) to 256"};
  }
  return Done{};
}

class HapticLoopImpl final : public HapticLoop {
 public:
  struct Parts {
    std::unique_ptr<Coupling> coupling;
    SafetyFilter safety;
    SurfaceTimeline timeline;
    std::unique_ptr<ContactQuery> query;
    ForceScale scale;
    std::vector<std::string> notes;
  };

  HapticLoopImpl(const Tool& tool, DepthSource& source, HapticDevice& device,
                 const HapticSettings& settings, HapticObserver observer, Parts parts)
      : device_(device),
        settings_(settings),
        observer_(std::move(observer)),
        notes_(std::move(parts.notes)),
        tick_seconds_(1 / device.info().rate),
        coupling_(std::move(parts.coupling)),
        safety_(std::move(parts.safety)),
        records_(observer_.on_ticks ? kNumRecords : 0),
        surfaces_(source, std::move(parts.timeline), settings.num_threads,
                  static_cast<bool>(observer_.on_frame), times_.surface_compute),
        contacts_(std::move(parts.query), surfaces_,
                  {settings.contact, settings.contact_rate, tick_seconds_,
                   tool.sphere_mass().centre_of_mass, parts.scale, settings.wants_real_time,
                   static_cast<bool>(observer_.on_contact), 0},
                  times_.contact_compute) {
    batch_.reserve(kBatch);
  }
  ~HapticLoopImpl() override { stop(); }

  Status start() override;
  void stop() noexcept override;
  bool is_running() const noexcept override { return is_running_.load(std::memory_order_acquire); }
  bool latest(HapticRecord& record) noexcept override;
  const LoopTimes& times() const noexcept override { return times_; }
  LoopReport report() const override;
  Status status() const override;

 private:
  Status start_all();
  Wrench tick(const DeviceState& state) noexcept;
  double step_seconds(const DeviceState& state) noexcept;
  void keep_time(double begin, const HapticRecord& record) noexcept;
  void publish_all();
  void drain_queues();
  void fade_out() noexcept;

  HapticDevice& device_;
  const HapticSettings settings_;
  const HapticObserver observer_;
  std::vector<std::string> notes_;
  const double tick_seconds_;
  LoopTimes times_;

  // Of the haptic thread.
  std::unique_ptr<Coupling> coupling_;
  SafetyFilter safety_;
  bool has_tool_ = false, is_stopping_ = false;
  double last_state_time_ = 0, last_begin_ = 0, first_tick_ = 0;

  // From the haptic thread to others.
  TripleBuffer<HapticRecord> newest_;
  RecordQueue<HapticRecord> records_;
  std::atomic<std::uint64_t> num_ticks_ = 0, num_missed_ = 0;
  std::atomic<Fault> fault_ = Fault::none;
  std::atomic<bool> has_faded_ = false;
  std::atomic<int> real_time_error_ = 0;

  std::atomic<bool> wants_stop_ = false, is_running_ = false;
  std::atomic<double> start_time_ = 0, end_time_ = 0;
  bool was_started_ = false, has_locked_memory_ = false;
  StopSignal stop_publishing_;
  std::vector<HapticRecord> batch_;

  SurfaceStage surfaces_;
  ContactStage contacts_;
  std::thread publishing_thread_;
};

Status HapticLoopImpl::start() {
  if (was_started_) {
    return Error{Errc::invalid_argument, "a haptic loop starts once; create another one"};
  }
  was_started_ = true;
  start_time_ = end_time_ = monotonic_now();
  const Status started = start_all();
  if (!started) stop();
  return started;
}

Status HapticLoopImpl::start_all() {
  try {
    if (const Status seen = surfaces_.start(); !seen) return seen;
    start_time_ = monotonic_now();
    contacts_.start(start_time_);
    publishing_thread_ = std::thread([this] { publish_all(); });
  } catch (const std::system_error& error) {
    return Error{Errc::unavailable, std::string("the system gives no thread for the loop: ") +
                                        error.what() + "; end other programs and try again"};
  }
  if (settings_.wants_real_time) {
    const int refused = lock_memory();
    has_locked_memory_ = refused == 0;
    if (refused != 0) notes_.push_back(memory_lock_refused(refused));
  }
  const double begin = monotonic_now();
  is_running_.store(true, std::memory_order_release);
  if (const Status ticks = device_.start([this](const DeviceState& state) { return tick(state); });
      !ticks) {
    return ticks;
  }
  while (num_ticks_.load(std::memory_order_acquire) == 0) {
    if (const Status device = device_.status(); !device) return device;
    if (monotonic_now() - begin > kFirstTickTimeout) {
      return Error{Errc::unavailable,
                   device_.info().name + " does not tick; switch it off and on and try again"};
    }
    std::this_thread::sleep_for(std::chrono::milliseconds(1));
  }
  return Done{};
}

void HapticLoopImpl::fade_out() noexcept {
  wants_stop_.store(true, std::memory_order_release);
  const double limit = monotonic_now() + settings_.safety.fade_seconds + kFadeTimeout;
  // A device that is lost does not tick, and its motors are off.
  while (!has_faded_.load(std::memory_order_acquire) && monotonic_now() < limit &&
         device_.status()) {
    std::this_thread::sleep_for(std::chrono::milliseconds(1));
  }
}

void HapticLoopImpl::stop() noexcept {
  if (num_ticks_.load(std::memory_order_acquire) > 0 && publishing_thread_.joinable()) fade_out();
  if (was_started_) device_.stop();
  if (is_running_.exchange(false)) end_time_ = monotonic_now();
  // The contact thread first: the surface thread waits for it at most until it is told to stop.
  contacts_.stop();
  surfaces_.stop();
  stop_publishing_.stop();
  if (publishing_thread_.joinable()) publishing_thread_.join();
  if (std::exchange(has_locked_memory_, false)) unlock_memory();
}

Wrench HapticLoopImpl::tick(const DeviceState& state) noexcept {
  const double begin = monotonic_now();
  if (num_ticks_.load(std::memory_order_relaxed) == 0) {
    first_tick_ = state.time;
    if (settings_.wants_real_time) real_time_error_.store(ask_for_real_time(kHapticPriority));
  }
  const KnownContact& known = contacts_.newest();
  HapticRecord& record = newest_.draft();
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
  keep_time(begin, record);
  return felt;
}

/// The hand moves the tool, from the first usable state on; until then 0.
double HapticLoopImpl::step_seconds(const DeviceState& state) noexcept {
  if (!has_tool_) {
    if (!state.is_valid) return 0;
    coupling_->reset(state);
    has_tool_ = true;
    last_state_time_ = state.time - tick_seconds_;
  }
  // A late tick is a longer step, but not one without bounds.
  const double dt =
      std::clamp(state.time - last_state_time_, tick_seconds_ / 10, 10 * tick_seconds_);
  last_state_time_ = state.time;
  return dt;
}

/// Statistics, and the record on its way to the others.
void HapticLoopImpl::keep_time(double begin, const HapticRecord& record) noexcept {
  if (record.safety.fault != Fault::none) {
    fault_.store(record.safety.fault, std::memory_order_relaxed);
    if (record.safety.gain <= 0) has_faded_.store(true, std::memory_order_release);
  }
  const std::uint64_t number = num_ticks_.load(std::memory_order_relaxed);
  if (number > 0) times_.haptic_period.record(nanoseconds(begin - last_begin_));
  last_begin_ = begin;
  if (record.contact_number > 0) {
    times_.contact_age.record(nanoseconds(record.contact_age));
    times_.sensor_to_force.record(nanoseconds(record.sensor_age));
  }
  const double took = monotonic_now() - begin;
  newest_.draft().compute_nanoseconds = nanoseconds(took);
  times_.haptic_compute.record(nanoseconds(took));
  if (took > tick_seconds_) num_missed_.fetch_add(1, std::memory_order_relaxed);
  if (observer_.on_ticks) records_.push(newest_.draft());
  newest_.publish();
  num_ticks_.store(number + 1, std::memory_order_release);
}

bool HapticLoopImpl::latest(HapticRecord& record) noexcept {
  if (!newest_.refresh()) return false;
  record = newest_.value();
  return true;
}

/// Also notices when the haptic thread cannot: a device that is lost does not tick.
void HapticLoopImpl::publish_all() {
  bool is_last = false;
  while (!is_last) {
    is_last = stop_publishing_.sleep_for(kPublishingPeriod);
    drain_queues();
    const bool has_ended = has_faded_.load(std::memory_order_acquire) || !device_.status();
    if (has_ended && is_running_.exchange(false)) end_time_ = monotonic_now();
  }
}

void HapticLoopImpl::drain_queues() {
  while (const SeenFrame* seen = surfaces_.seen().front()) {
    observer_.on_frame(seen->number, seen->time, seen->frame);
    surfaces_.seen().pop();
  }
  while (const ContactRecord* contact = contacts_.records().front()) {
    observer_.on_contact(*contact);
    contacts_.records().pop();
  }
  while (records_.front() != nullptr) {
    batch_.clear();
    for (const HapticRecord* record = records_.front(); record != nullptr && batch_.size() < kBatch;
         record = records_.front()) {
      batch_.push_back(*record);
      records_.pop();
    }
    observer_.on_ticks(batch_);
  }
}

LoopReport HapticLoopImpl::report() const {
  LoopReport report;
  report.num_ticks = num_ticks_;
  report.num_contacts = contacts_.num_contacts();
  report.num_frames = surfaces_.num_frames();
  report.num_missed = num_missed_;
  report.num_lost_records = records_.num_lost() + surfaces_.num_lost() + contacts_.num_lost();
  report.notes = notes_;
  report.fault = fault_;
  report.seconds = (is_running() ? monotonic_now() : end_time_.load()) - start_time_;
  const auto note = [&](std::string text) { report.notes.push_back(std::move(text)); };
  if (const int refused = real_time_error_) note(scheduler_refused("haptic", refused));
  if (const int refused = contacts_.real_time_error()) note(scheduler_refused("contact", refused));
  if (const auto skipped = surfaces_.num_skipped()) {
    note(std::to_string(skipped) +
         " depth frames were left out, because surfaces take longer than a frame; a smaller image "
         "or a GPU helps");
  }
  if (const auto spared = contacts_.num_spared_stiffnesses()) {
    note("the contact stiffness was kept from an earlier query at " + std::to_string(spared) +
         " of " + std::to_string(report.num_contacts) +
         ", because there was no time for it; fewer spheres or a GPU help");
  }
  return report;
}

Status HapticLoopImpl::status() const {
  if (const Status device = device_.status(); !device) return device;
  if (const Status surfaces = surfaces_.status(); !surfaces) return surfaces;
  if (contacts_.has_backend_failed()) {
    return Error{Errc::unavailable,
                 "the GPU did not answer a contact query in time or is lost; check it with "
                 "nvidia-smi, or use the CPU (--backend cpu)"};
  }
  switch (const Fault fault = fault_) {
    case Fault::none:
    case Fault::stopped: return Done{};
    default: return Error{Errc::unavailable, std::string(describe(fault))};
  }
}

}  // namespace

Result<std::unique_ptr<HapticLoop>> HapticLoop::create(const Tool& tool, DepthSource& source,
                                                       HapticDevice& device,
                                                       const HapticSettings& settings,
                                                       HapticObserver observer) {
  if (const Status status = check(settings); !status) return status.error();
  const DeviceInfo& info = device.info();
  if (!(info.rate > 0 && std::isfinite(info.rate))) {
    return Error{Errc::invalid_argument, info.name + " tells no rate of ticks; it cannot be used"};
  }
  auto coupling = check_coupling(settings.coupling, info.limits, 1 / info.rate);
  if (!coupling) return coupling.error();
  auto safety = SafetyFilter::create(info.limits, settings.safety);
  if (!safety) return safety.error();
  std::optional<DepthFieldOptions> field;
  if (settings.contact.method == InsideMethod::field) field = settings.field;
  auto timeline =
      SurfaceTimeline::create(source.info(), settings.surface, field, settings.time,
                              {settings.backend, settings.sensing_gpu}, SurfaceStage::kNumSpare);
  if (!timeline) return timeline.error();
  ContactCapacities capacities;
  capacities.gpu = settings.contact_gpu;
  auto query = make_contact_query(settings.backend, tool, capacities);
  if (!query) return query.error();

  HapticLoopImpl::Parts parts{
      make_coupling(coupling->options, info.limits, tool.sphere_mass()),
      *std::move(safety),
      *std::move(timeline),
      *std::move(query),
      thesis_force_scale(coupling->options.force_at_eighth, full_volume(tool, settings.contact)),
      std::move(coupling->warnings)};
  return std::unique_ptr<HapticLoop>(std::make_unique<HapticLoopImpl>(
      tool, source, device, settings, std::move(observer), std::move(parts)));
}

}  // namespace palpate
