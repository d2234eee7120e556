#include "src/run/loop/live_loop.h"

#include <algorithm>
#include <system_error>
#include <tuple>
#include <utility>

#include "src/core/internal/guarded.h"
#include "src/core/internal/monotonic_clock.h"
#include "src/run/check_settings.h"

namespace palpate { inline namespace v0 {
namespace {

constexpr double kPublishingPeriod = 0.005;  // s
constexpr double kFirstTickTimeout = 2;      // s
constexpr double kFadeTimeout = 0.5;         // s, beyond the fade itself
constexpr double kMaxSilence = 1;            // s without a tick until a device counts as stuck
constexpr double kLongStart = 2;             // s until a note says that the device is starting

/// Makes the threads of queries: one for each 50000 spheres, at most four and no more than there
/// are cores. They are woken a thousand times a second, so each needs some hundred microseconds of
/// work.
std::unique_ptr<ThreadPool> make_query_threads(const RunSettings& settings,
                                               std::size_t num_spheres) {
  constexpr std::size_t kSpheresPerThread = 50000, kMaxThreads = 4;
  const auto desired = static_cast<int>(std::min(1 + num_spheres / kSpheresPerThread, kMaxThreads));
  return std::make_unique<ThreadPool>(
      std::min(desired, num_threads_for(settings.num_threads)),
      settings.wants_real_time ? ContactStage::begin_thread : nullptr);
}

}  // namespace

Status LiveLoop::start() {
  if (was_started_) {
    return Error{Errc::invalid_argument, "a run starts once; create another loop"};
  }
  was_started_ = true;
  start_time_ = end_time_ = monotonic_now();
  const Status started = start_all();
  if (!started) stop();
  return started;
}

/// Locks memory first, which takes 0.1 s or more: later, frames would pass by meanwhile.
Status LiveLoop::start_all() {
  lock_all_memory();
  try {
    if (const Status seen = surfaces_.start(); !seen) return seen;
    start_time_ = monotonic_now();
    haptic_.set_start_time(start_time_);
    is_device_starting_ = true;
    is_running_.store(true, std::memory_order_release);  // until one of the threads ends it
    const auto fail = [this](const Error& error) { end_with(error); };
    contacts_.start(start_time_, fail);
    publishing_thread_ = std::thread([this, fail] {
      guarded([&] { publish_all(); }, fail);
      end();  // without this thread nobody would notice
    });
    minding_thread_ = std::thread([this, fail] { guarded([&] { mind_all(); }, fail); });
  } catch (const std::system_error& error) {
    return Error{Errc::unavailable, std::string("cannot start the threads of the loop: ") +
                                        error.what() + "; end other programs and try again"};
  }
  if (memory_.is_held()) memory_.hold();  // memory of the new threads: little
  const Status ticks =
      device_.start([this](const DeviceState& state) { return haptic_.tick(state); });
  is_device_starting_ = false;
  if (!ticks) return ticks;
  double patience = kFirstTickTimeout;
  wait_for(patience, [this] { return haptic_.num_ticks() > 0 || !device_.status(); });
  if (haptic_.num_ticks() == 0) {
    if (const Status device = device_.status(); !device) return device;
    return Error{Errc::unavailable,
                 device_.info().name + " does not tick; switch it off and on and try again"};
  }
  num_before_ticks_ = surfaces_.num_skipped();
  return Done{};
}

void LiveLoop::lock_all_memory() {
  if (!first_settings_.wants_real_time) return;
  if (const int refused = memory_.hold()) notes_.push_back(memory_lock_refused(refused));
}

/// Ends the run after a thread has failed. The hand needs no memory to fade out.
void LiveLoop::end_with(const Error& error) {
  has_failed_ = true;
  haptic_.request_stop();
  const std::lock_guard lock(mutex_);
  if (failure_) failure_ = error;
}

void LiveLoop::end() noexcept {
  if (is_running_.exchange(false)) end_time_ = monotonic_now();
}

void LiveLoop::suspend_force() {
  publisher_.add_note("the program is about to stand still: the force is off until it goes on");
  haptic_.suspend(true);
  wait_without(&HapticStage::is_without_force);
}

/// Waits until the force is away, as requested: for the fade and at most kFadeTimeout longer.
void LiveLoop::wait_without(bool (HapticStage::*force)() const noexcept) noexcept {
  double patience = first_settings_.safety.fade_seconds + kFadeTimeout;
  // A device that is lost or stuck does not tick.
  wait_for(patience, [&] {
    bool has_ended = (haptic_.*force)();
    guarded([&] { has_ended = has_ended || has_device_ended(); }, [](const Error&) {});
    return has_ended;
  });
}

void LiveLoop::stop() noexcept {
  if (haptic_.num_ticks() > 0 && publishing_thread_.joinable()) {
    haptic_.request_stop();
    wait_without(&HapticStage::has_faded);
  }
  end();  // from here on, a device that does not tick is not stuck
  if (was_started_) device_.stop();
  // The contact thread first: the surface thread waits for it at most until it is stopped.
  contacts_.stop();
  surfaces_.stop();
  stop_publishing_.stop();
  if (publishing_thread_.joinable()) publishing_thread_.join();
  if (minding_thread_.joinable()) minding_thread_.join();
  memory_.release();
}

/// True if the device is stuck, which it may not know. It counts rounds of this thread: while the
/// whole process stood still, there were none.
bool LiveLoop::has_stopped_ticking() {
  const std::uint64_t num_ticks = haptic_.num_ticks();
  const bool is_silent = num_ticks > 0 && num_ticks == std::exchange(num_seen_ticks_, num_ticks);
  num_silent_rounds_ = is_silent ? num_silent_rounds_ + 1 : 0;
  return num_silent_rounds_ * kPublishingPeriod >
         std::max({kMaxSilence, first_settings_.safety.max_tick, 10 / device_.info().rate});
}

/// True once if the start takes long: a robot's first pose, for instance, may take ten seconds.
bool LiveLoop::is_start_long() {
  const bool is_long = is_device_starting_ && monotonic_now() - start_time_ > kLongStart;
  return is_long && !std::exchange(was_start_long_, true);
}

/// Publishes all records, and ends the run of a lost device, whose haptic thread ticks no more.
void LiveLoop::publish_all() {
  if (first_settings_.wants_real_time) recorder_nice_ = take_rank(ThreadRank::recorder);
  bool is_last = false;
  while (!is_last) {
    is_last = stop_publishing_.sleep_for(kPublishingPeriod);
    if (is_start_long()) publisher_.add_note("waits for " + device_.info().name + " to start");
    // After a failure, the observer may hold half of a record.
    if (!has_failed_) {
      guarded([&] { publisher_.publish(); }, [&](const Error& error) { end_with(error); });
    }
    if (is_running() && has_stopped_ticking()) is_device_stuck_ = true;
    // Before its start, the device may report the end of an earlier run.
    if (!is_device_starting_ && (haptic_.has_faded() || has_device_ended())) end();
  }
}

std::vector<std::pair<std::string, std::string>> LiveLoop::scheduling() const {
  const bool is_requested = first_settings_.wants_real_time;
  const auto nice = [](int value) { return "nice " + std::to_string(value); };
  const auto real_time = [&](int refused) {
    return std::string(is_requested && refused == 0 ? "real time" : "as other programs");
  };
  return {{"haptic", real_time(haptic_.real_time_error())},
          {"contact", real_time(contacts_.real_time_error())},
          {"surface", nice(surfaces_.nice())},
          {"recorder", nice(recorder_nice_)}};
}

LoopReport LiveLoop::report() const {
  LoopReport report;
  report.num_ticks = haptic_.num_ticks();
  report.num_contacts = contacts_.num_contacts();
  report.num_frames = surfaces_.num_frames();
  report.num_missed = haptic_.num_missed();
  report.num_lost_records = haptic_.num_lost() + surfaces_.num_lost() + contacts_.num_lost();
  {
    const std::lock_guard lock(mutex_);
    report.notes = notes_;
    std::tie(report.page_thinned, report.image_thinned, report.spheres_thinned) =
        std::tie(thinned_[0], thinned_[1], thinned_[2]);
  }
  report.scheduling = scheduling();
  report.fault = haptic_.fault();
  // The safety filter knows a device only by its ticks. A path that has ended is no fault.
  const Status device = device_.status();
  if (is_device_stuck_ || (!device && device.error().code != Errc::cancelled))
    report.fault = Fault::device;
  report.num_faults = haptic_.num_faults();
  if (const int camera = surfaces_.ended_camera(); camera >= 0) {
    const auto which = static_cast<std::size_t>(camera);
    report.ending = frames_have_ended(streams_[which].name, which, streams_.size());
  }
  report.seconds = (is_running() ? monotonic_now() : end_time_.load()) - start_time_;
  const auto note = [&](std::string text) { report.notes.push_back(std::move(text)); };
  if (const int refused = haptic_.real_time_error()) note(scheduler_refused("haptic", refused));
  if (const int refused = contacts_.real_time_error()) note(scheduler_refused("contact", refused));
  const std::uint64_t skipped = surfaces_.num_skipped(), before = num_before_ticks_.load();
  report.num_left_out = skipped > before ? skipped - before : 0;
  report.num_spared_stiffnesses = contacts_.num_spared_stiffnesses();
  if (report.num_left_out > 0) {
    note(frames_left_out(report.num_left_out, surfaces_.num_late(), times_.surface_compute,
                         slowest_rate() > 0 ? 1 / slowest_rate() : 1.0 / 30));
  }
  if (std::string text = time_thinned(report); !text.empty()) note(std::move(text));
  if (const auto outside = contacts_.num_outside_window()) {
    note("at " + std::to_string(outside) + " of " + std::to_string(report.num_contacts) +
         " contacts the tool was so fast that it had left the processed window of the image, so "
         "there was no force; raise window.speed or set window.enabled = false");
  }
  if (report.num_spared_stiffnesses > 0) {
    note("the contact stiffness was kept from an earlier query at " +
         std::to_string(report.num_spared_stiffnesses) + " of " +
         std::to_string(report.num_contacts) +
         ", because there was no time for it; fewer spheres or a GPU help");
  }
  return report;
}

Status LiveLoop::status() const {
  if (const Status device = device_.status(); !device) return device;
  if (const Status surfaces = surfaces_.status(); !surfaces) return surfaces;
  if (is_backend_lost_) return lost_backend();
  {
    const std::lock_guard lock(mutex_);
    if (!failure_) return failure_;
  }
  if (is_device_stuck_) {
    return Error{Errc::unavailable, device_.info().name +
                                        " does not tick any more; switch it off and on, check "
                                        "its cable and try again"};
  }
  switch (const Fault fault = haptic_.fault()) {
    case Fault::none:
    case Fault::stopped: return Done{};
    default: return Error{Errc::unavailable, std::string(describe(fault))};
  }
}

Result<std::unique_ptr<RunLoop>> RunLoop::create(const Tool& tool, const DepthSources& sources,
                                                 HapticDevice& device, const RunSettings& settings,
                                                 RunObserver observer) {
  if (const Status status = check_rates(settings, device.info()); !status) return status.error();
  auto query_threads = make_query_threads(settings, tool.spheres().size());
  const RunPartsOptions options{nullptr, SurfaceStage::kNumSpare, query_threads.get()};
  auto index = ToolIndex::create(tool);
  auto parts = make_run_parts(index, sources.infos(), device.info(), settings, options);
  if (!parts) return parts.error();
  auto safety = SafetyFilter::create(device.info().limits, settings.safety);
  if (!safety) return safety.error();
  add_notes(parts->notes, notes_on_rates(settings, device.info()));
  return std::unique_ptr<RunLoop>(
      std::make_unique<LiveLoop>(std::move(index), sources, device, settings, std::move(observer),
                                 std::move(query_threads), *std::move(parts), *std::move(safety)));
}

}}  // namespace palpate::v0
