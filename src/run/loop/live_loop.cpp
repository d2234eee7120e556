#include "palpate/run/run_loop.h"

#include <algorithm>
#include <array>
#include <atomic>
#include <mutex>
#include <system_error>
#include <thread>
#include <tuple>
#include <utility>

#include "src/core/internal/guarded.h"
#include "src/core/internal/monotonic_clock.h"
#include "src/core/internal/thread_rank.h"
#include "src/run/internal/event.h"
#include "src/run/internal/pipeline.h"
#include "src/run/internal/real_time.h"
#include "src/run/loop/contact_stage.h"
#include "src/run/loop/haptic_stage.h"
#include "src/run/loop/load_governor.h"
#include "src/run/loop/publisher.h"
#include "src/run/loop/rates.h"
#include "src/run/loop/surface_stage.h"
#include "src/run/setting_changes.h"

namespace palpate { inline namespace v0 {
namespace {

constexpr double kPublishingPeriod = 0.005;  // s
constexpr double kMindingPeriod = 0.02;      // s
constexpr double kFirstTickTimeout = 2;      // s
constexpr double kFadeTimeout = 0.5;         // s, beyond the fade itself
// Longest wait for a change, s, beyond three frames: its caller may also need to request the end of
// the run.
constexpr double kChangeTimeout = 2;
constexpr double kMaxSilence = 1;  // s without a tick, or safety.max_tick: a device is stuck
constexpr double kLongStart = 2;   // s until a note says that the device is starting

/// Waits for a condition, at most for `patience` s, of which the rest remains. It counts its
/// rounds: time in which the whole process stands still is not counted.
template <class Condition>
void wait_for(double& patience, const Condition& has_come) {
  constexpr double kRound = 1e-3;  // s
  for (; !has_come() && patience > 0; patience -= kRound) {
    std::this_thread::sleep_for(std::chrono::duration<double>(kRound));
  }
}

/// A query of a large tool takes more than one thread, which are woken a thousand times a second:
/// few enough that each has some hundred microseconds to compute, none more than there are cores.
std::unique_ptr<ThreadPool> make_query_threads(const RunSettings& settings,
                                               std::size_t num_spheres) {
  constexpr std::size_t kSpheresPerThread = 50000, kMaxThreads = 4;
  const auto desired = static_cast<int>(std::min(1 + num_spheres / kSpheresPerThread, kMaxThreads));
  return std::make_unique<ThreadPool>(
      std::min(desired, num_threads_for(settings.num_threads)),
      settings.wants_real_time ? ContactStage::begin_thread : nullptr);
}

/// Other settings on their way through the stages.
struct Change {
  RunSettings settings;
  std::uint32_t revision = 0;
  double patience = 0;  // s left to wait for it
  SurfaceChange surfaces;
  ContactChange contacts;
  HapticChange haptic;
};

class LiveLoop final : public RunLoop {
 public:
  LiveLoop(std::shared_ptr<const ToolIndex> index, const DepthSources& sources,
           HapticDevice& device, const RunSettings& settings, RunObserver observer,
           std::unique_ptr<ThreadPool> query_threads, RunParts parts, SafetyFilter safety)
      : index_(std::move(index)),
        device_(device),
        streams_(sources.infos()),
        first_settings_(settings),
        observer_(std::move(observer)),
        query_threads_(std::move(query_threads)),
        settings_(settings),
        notes_(std::move(parts.notes)),
        governor_(streams_.front(), settings, index_->tool().spheres().size()),
        surfaces_(sources, std::move(parts.timelines), settings, ball_of(index_->tool()),
                  static_cast<bool>(observer_.on_frame), times_.surface_compute),
        contacts_(std::move(parts.contact), surfaces_,
                  {settings.contact_rate, 1 / device.info().rate, index_->tool().spheres().size(),
                   settings.wants_real_time, static_cast<bool>(observer_.on_contact), 0},
                  times_.contact_compute),
        haptic_({std::move(parts.coupling), std::move(safety), 1 / device.info().rate}, surfaces_,
                contacts_,
                {1 / device.info().rate, settings.wants_real_time,
                 static_cast<bool>(observer_.on_ticks)},
                times_),
        publisher_(observer_, {surfaces_.seen(), contacts_.records(), haptic_.records(),
                               haptic_.snapshots(), [this] { return surfaces_.num_frames(); },
                               [this] { return contacts_.num_contacts(); }}) {}
  ~LiveLoop() override { stop(); }

  Status start() override;
  void request_force() noexcept override { haptic_.request_force(); }
  void suspend_force() override;
  void resume_force() noexcept override { haptic_.suspend(false); }
  void stop() noexcept override;
  bool is_running() const noexcept override { return is_running_.load(std::memory_order_acquire); }
  bool latest(TickRecord& record) noexcept override { return haptic_.latest(record); }
  const LoopTimes& times() const noexcept override { return times_; }
  LoopReport report() const override;
  Status status() const override;

  Status change(const RunSettings& settings) override;
  RunSettings settings() const override {
    const std::lock_guard lock(mutex_);
    return settings_;
  }
  void hold_frames(bool is_held) noexcept override { surfaces_.hold(is_held); }
  void step_frame() noexcept override { surfaces_.step(); }
  bool is_short_of_time() const noexcept override { return is_page_thinned_.load(); }
  void request_contact_picture(PictureConsumer who) noexcept override {
    num_pictures_.fetch_add(1);
    contacts_.request_picture(who);
  }
  void request_surface_picture() noexcept override {
    num_pictures_.fetch_add(1);
    surfaces_.request_picture();
  }
  const ContactPicture* new_contact_picture(PictureConsumer who) noexcept override {
    return contacts_.new_picture(who);
  }
  const SurfacePicture* new_surface_picture() noexcept override { return surfaces_.new_picture(); }

 private:
  Status start_all();
  void lock_all_memory();
  Status begin_change(const RunSettings& settings);
  void offer_change();
  bool is_change_taken();
  Status finish_change();
  void end_change();
  void mind_all();
  bool may_begin_change();
  void look_after_backend();
  void look_after_load();
  LoadCounts count_load(double contact_rate) const;
  double slowest_rate() const;
  void publish_all();
  bool has_stopped_ticking();
  bool is_start_long();
  /// True if the device ticks no more: lost, stuck, or at the end of its path.
  bool has_device_ended() const { return is_device_stuck_ || !device_.status(); }
  void end_with(const Error& error);
  void end() noexcept;
  void wait_without(bool (HapticStage::*force)() const noexcept) noexcept;
  std::vector<std::pair<std::string, std::string>> scheduling() const;

  const std::shared_ptr<const ToolIndex> index_;
  HapticDevice& device_;
  const std::vector<DepthStreamInfo> streams_;
  const RunSettings first_settings_;
  const RunObserver observer_;
  LoopTimes times_;
  const std::unique_ptr<ThreadPool> query_threads_;

  // Used by the thread that changes settings.
  std::mutex changing_;
  std::unique_ptr<Change> change_;  // not yet taken by all stages
  // Shared by that thread and the publishing one.
  mutable std::mutex mutex_;
  RunSettings settings_;  // as all stages have them
  std::vector<std::string> notes_;
  Status failure_ = Done{};          // of the first thread that threw
  std::array<double, 3> thinned_{};  // s: page, image, spheres
  // Used by the publishing thread only.
  std::uint64_t num_seen_ticks_ = 0;
  int num_silent_rounds_ = 0;
  bool was_start_long_ = false;
  // Used by the minding thread only.
  bool is_changing_backend_ = false;
  LoadGovernor governor_;

  std::atomic<bool> is_running_ = false, is_backend_lost_ = false, is_page_thinned_ = false;
  std::atomic<bool> has_failed_ = false, is_device_stuck_ = false, is_device_starting_ = false;
  std::atomic<std::uint64_t> num_pictures_ = 0;  // requested
  std::atomic<int> recorder_nice_ = 0;
  std::atomic<double> start_time_ = 0, end_time_ = 0;
  std::atomic<std::uint64_t> num_before_ticks_ = 0;  // frames before the first tick
  std::uint32_t revision_ = 0;
  bool was_started_ = false;
  MemoryLock memory_;
  StopSignal stop_publishing_;

  SurfaceStage surfaces_;
  ContactStage contacts_;
  HapticStage haptic_;
  Publisher publisher_;
  std::thread publishing_thread_, minding_thread_;
};

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

Status LiveLoop::change(const RunSettings& settings) {
  const std::lock_guard lock(changing_);
  if (change_) {
    if (const Status last = finish_change(); !last) return last;
  }
  if (!is_running() || contacts_.num_contacts() == 0) {
    return Error{Errc::unavailable,
                 "settings change while a tool is in the hand and the loop runs; it has ended or "
                 "not begun to feel"};
  }
  const Status begun = begin_change(settings);
  return begun ? finish_change() : begun;
}

/// Makes the parts of a change and offers them to the stages.
Status LiveLoop::begin_change(const RunSettings& settings) {
  if (const Status status = check_change(settings_, settings); !status) return status;
  if (const Status status = check_rates(settings, device_.info()); !status) return status;
  const RunPartsOptions options{&settings_, SurfaceStage::kNumSpare, query_threads_.get()};
  auto parts = make_run_parts(index_, streams_, device_.info(), settings, options);
  if (!parts) return parts.error();

  change_ = std::make_unique<Change>();
  const std::uint32_t revision = change_->revision = ++revision_;
  change_->settings = settings;
  change_->patience = kChangeTimeout + 3 / std::max(slowest_rate(), 0.1);
  change_->surfaces = {revision, std::move(parts->timelines)};
  change_->contacts = {revision, change_->surfaces.timelines.empty() ? 0 : revision,
                       settings.contact_rate, parts->scale, std::move(parts->contact)};
  change_->haptic = {revision, std::move(parts->coupling)};
  publisher_.add_settings(settings);
  {
    const std::lock_guard lock_others(mutex_);
    add_notes(notes_, parts->notes);
  }
  offer_change();
  return Done{};
}

void LiveLoop::offer_change() {
  const bool has_surfaces = !change_->surfaces.timelines.empty();
  contacts_.changes().offer(change_->contacts);
  if (has_surfaces) {
    surfaces_.changes().offer(change_->surfaces);
  } else {
    surfaces_.set_revision(change_->revision);
  }
  surfaces_.set_motion_scale(change_->settings.coupling.motion_scale);
  haptic_.changes().offer(change_->haptic);
}

bool LiveLoop::is_change_taken() {
  return haptic_.changes().is_settled() && contacts_.changes().is_settled() &&
         surfaces_.changes().is_settled();
}

/// Waits until all stages have taken the change.
Status LiveLoop::finish_change() {
  wait_for(change_->patience, [this] { return is_change_taken() || !is_running(); });
  if (!is_change_taken()) {
    return Error{Errc::unavailable,
                 is_running() ? "the loop has not taken the last change yet: no depth frame or "
                                "tick comes, and it will come with the next ones; check the "
                                "sensor and the device"
                              : "the loop has ended before it took the change"};
  }
  end_change();
  return Done{};
}

/// Makes the new settings the present ones and destroys the parts that they have replaced.
void LiveLoop::end_change() {
  {
    const std::lock_guard lock(mutex_);
    settings_ = change_->settings;
  }
  change_.reset();
}

/// Changes settings without a request of the user. It has its own thread, because new parts may
/// take long to make, and recording must not wait for them.
void LiveLoop::mind_all() {
  if (first_settings_.wants_real_time) take_rank(ThreadRank::recorder);
  while (!stop_publishing_.sleep_for(kMindingPeriod)) {
    // A change that the user requests comes first.
    const std::unique_lock lock(changing_, std::try_to_lock);
    if (!lock || !is_running()) continue;
    look_after_backend();
    if (first_settings_.may_thin) look_after_load();
  }
}

/// True if no change is on its way through the stages; ends the last one if it is through.
bool LiveLoop::may_begin_change() {
  if (change_ && !is_change_taken()) return false;
  if (change_) end_change();
  return true;
}

/// Returns the lowest frame rate of all cameras, Hz: contacts are as old as its frames.
double LiveLoop::slowest_rate() const {
  double slowest = streams_.front().rate;
  for (const DepthStreamInfo& stream : streams_) slowest = std::min(slowest, stream.rate);
  return slowest;
}

LoadCounts LiveLoop::count_load(double contact_rate) const {
  LoadCounts counts;
  counts.ticks = haptic_.num_ticks();
  counts.frames = surfaces_.num_read();
  counts.pictures = num_pictures_.load();
  counts.count_ages(times_, first_settings_.safety, slowest_rate(), contact_rate,
                    device_.info().rate);
  return counts;
}

/// Reduces the load if computing time is short, and restores it later.
void LiveLoop::look_after_load() {
  if (!may_begin_change()) return;
  const RunSettings present = settings();
  LoadGovernor::Decision decision =
      governor_.look(monotonic_now(), present, count_load(present.contact_rate));
  Status done = Done{};
  if (decision.settings) done = begin_change(*decision.settings);
  if (!done) {
    governor_.give_up(present);
    decision.note = "less could not be computed: " + done.error().message;
  }
  is_page_thinned_ = governor_.steps().page > 0;
  const std::lock_guard lock(mutex_);
  thinned_ = {governor_.page_seconds(), governor_.image_seconds(), governor_.spheres_seconds()};
  if (decision.note.empty()) return;
  publisher_.add_note(std::move(decision.note));
  // The new settings are judged by a window of their own.
  governor_.begin_window(monotonic_now(), count_load(present.contact_rate));
}

/// Replaces a lost GPU by the CPU.
void LiveLoop::look_after_backend() {
  const auto has_failed = [&] {
    return surfaces_.has_backend_failed() || contacts_.has_backend_failed();
  };
  if (!has_failed() && !is_changing_backend_) return;
  if (!may_begin_change()) return;
  is_changing_backend_ = false;
  if (!has_failed()) return;
  RunSettings settings = this->settings();
  Status begun = lost_backend();
  if (settings.backend != Backend::cpu) {
    settings.backend = Backend::cpu;
    begun = begin_change(settings);
  }
  is_changing_backend_ = begun.has_value();
  if (begun) {
    const char* const text =
        "the GPU is lost: surfaces and queries are computed on the CPU from now on";
    publisher_.add_note(text);
    const std::lock_guard lock_others(mutex_);
    notes_.push_back(text);
    return;
  }
  is_backend_lost_ = true;
  haptic_.request_stop();
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

}  // namespace

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
