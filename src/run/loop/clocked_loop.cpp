// A run on a simulated clock: frames, contacts and ticks in turn, in one thread.
#include <array>
#include <atomic>
#include <chrono>
#include <condition_variable>
#include <deque>
#include <mutex>
#include <thread>
#include <utility>

#include "palpate/run/run_loop.h"
#include "src/core/internal/guarded.h"
#include "src/core/internal/monotonic_clock.h"
#include "src/core/internal/triple_buffer.h"
#include "src/run/internal/pipeline.h"
#include "src/run/internal/surface_picture.h"
#include "src/run/loop/queues/frame_queue.h"

namespace palpate { inline namespace v0 {
namespace {

constexpr double kMaxLag = 0.25;  // s; a larger lag is not made up for
constexpr std::chrono::milliseconds kLongestWait{20};

std::int64_t nanoseconds(double seconds) { return static_cast<std::int64_t>(1e9 * seconds); }

class ClockedLoop final : public RunLoop {
 public:
  ClockedLoop(const DepthSources& sources, SteppedDevice& device, RunObserver observer,
              const SimulatedClock& clock, Pipeline pipeline)
      : device_(device),
        observer_(std::move(observer)),
        clock_(clock),
        pipeline_(std::move(pipeline)) {
    for (DepthSource* source : sources) cameras_.emplace_back(*source, clock.zero);
  }
  ~ClockedLoop() override { stop(); }

  Status start() override;
  void request_force() noexcept override { wants_force_ = true; }
  void stop() noexcept override;
  bool is_running() const noexcept override { return is_running_.load(std::memory_order_acquire); }
  std::optional<TickRecord> latest() noexcept override;
  const LoopTimes& times() const noexcept override { return times_; }
  LoopReport report() const override;
  Status status() const override;

  Status change(const RunSettings& settings) override;
  RunSettings settings() const override;
  void hold_frames(bool is_held) noexcept override;
  void step_frame() noexcept override;
  void request_contact_picture(PictureConsumer who) noexcept override {
    wants_contact_[std::size_t(who)] = true;
  }
  void request_surface_picture() noexcept override { wants_surface_ = true; }
  const ContactPicture* new_contact_picture(PictureConsumer who) noexcept override {
    TripleBuffer<ContactPicture>& contacts = contacts_[std::size_t(who)];
    return contacts.refresh() ? &contacts.value() : nullptr;
  }
  const SurfacePicture* new_surface_picture() noexcept override {
    return surfaces_.refresh() ? &surfaces_.value() : nullptr;
  }

 private:
  using Lock = std::unique_lock<std::mutex>;
  void work();
  bool wait_for_turn(Lock& lock);
  Wrench tick(const DeviceState& state);
  bool take_frames(double time);
  bool take_frame(std::size_t camera, double time);
  void make_pictures();
  void end(std::string ending);

  SteppedDevice& device_;
  const RunObserver observer_;
  const SimulatedClock clock_;
  LoopTimes times_;

  mutable std::mutex mutex_;  // guards the members below
  std::condition_variable has_changed_;
  struct Camera {
    Camera(DepthSource& source, std::optional<double> zero) : frames(source, zero) {}

    FrameQueue frames;
    std::uint64_t num_frames = 0;
    std::uint64_t newest = 0;  // FrameRecord::number
  };
  std::deque<Camera> cameras_;
  Pipeline pipeline_;
  LoopReport report_;
  Status status_ = Done{};
  bool has_ended_ = false, is_held_ = false;
  int num_steps_ = 0;
  double wall_offset_ = 0;  // s, monotonic, at time 0
  std::uint64_t contact_number_ = 0;

  std::atomic<bool> is_running_ = false, is_stopping_ = false;
  std::array<std::atomic<bool>, kNumPictureConsumers> wants_contact_ = {};
  std::atomic<bool> wants_surface_ = false, wants_force_ = false;
  TripleBuffer<TickRecord> newest_;
  std::array<TripleBuffer<ContactPicture>, kNumPictureConsumers> contacts_;
  TripleBuffer<SurfacePicture> surfaces_;
  std::thread thread_;
};

Status ClockedLoop::start() {
  for (Camera& camera : cameras_) {
    if (const Status status = camera.frames.start(); !status) return status;
  }
  const Status started = device_.start([this](const DeviceState& state) { return tick(state); });
  if (!started) return started;
  wall_offset_ = monotonic_now();
  is_running_ = true;
  const Status working = start_thread(thread_, "of the loop", [this] { work(); });
  if (!working) {
    is_running_ = false;
    stop();
  }
  return working;
}

void ClockedLoop::stop() noexcept {
  is_stopping_ = true;
  for (Camera& camera : cameras_) camera.frames.cancel();
  has_changed_.notify_all();
  if (thread_.joinable()) thread_.join();
  device_.stop();
}

void ClockedLoop::work() {
  const auto step_all = [this] {
    while (!is_stopping_) {
      Lock lock(mutex_);
      if (!wait_for_turn(lock)) break;
      if (!device_.step() && !has_ended_) end("the path has ended");
      if (has_ended_) break;
    }
  };
  guarded(step_all, [this](const Error& error) {
    const Lock lock(mutex_);
    has_ended_ = true;
    status_ = error;
  });
  is_running_ = false;
}

/// Waits until a tick may come; false: none will.
bool ClockedLoop::wait_for_turn(Lock& lock) {
  while (!is_stopping_) {
    if (contact_number_ > 0) make_pictures();
    const double now = monotonic_now(), next = report_.seconds;
    if (is_held_ && num_steps_ == 0) {
      wall_offset_ = now - next;
      has_changed_.wait_for(lock, kLongestWait);
      continue;
    }
    const double ahead = wall_offset_ + next - now;
    if (ahead < -kMaxLag) wall_offset_ = now - next;
    if (!clock_.keeps_pace || ahead <= 0) return true;
    has_changed_.wait_for(lock, std::min<std::chrono::duration<double>>(
                                    kLongestWait, std::chrono::duration<double>(ahead)));
  }
  return false;
}

void ClockedLoop::end(std::string ending) {
  has_ended_ = true;
  report_.ending = std::move(ending);
}

/// Takes the frames that are current at this time; false: there are none any more.
bool ClockedLoop::take_frames(double time) {
  const std::uint64_t before = report_.num_frames;
  for (std::size_t k = 0; k < cameras_.size(); ++k) {
    if (!take_frame(k, time)) return false;
  }
  if (report_.num_frames > before && num_steps_ > 0) --num_steps_;
  return true;
}

bool ClockedLoop::take_frame(std::size_t camera, double time) {
  FrameQueue& frames = cameras_[camera].frames;
  const auto fresh = frames.advance(time);
  if (!fresh) {
    status_ = error_of_camera(fresh.error(), frames.name(), camera, cameras_.size());
    return false;
  }
  if (clock_.ends_with_frames && frames.ended(time)) {
    end(frames_have_ended(frames.name(), camera, cameras_.size()));
    return false;
  }
  if (!*fresh) return true;
  const DepthFrame& frame = frames.current();
  FrameRecord record;
  record.number = cameras_[camera].newest = report_.num_frames++;
  record.camera = static_cast<std::uint32_t>(camera);
  record.camera_frame = cameras_[camera].num_frames++;
  record.capture_time = frames.current_time();
  record.source_time = frame.timestamp;
  record.unit = frame.unit;
  record.X_WC = frame.X_WC;
  const double begin = monotonic_now();
  record.surface = pipeline_.push(frame, record.capture_time, camera);
  const double took = monotonic_now() - begin;
  record.revision = pipeline_.frame_revision();
  record.compute_nanoseconds = nanoseconds(took);
  times_.surface_compute.record(record.compute_nanoseconds);
  if (observer_.on_frame) observer_.on_frame(record, frame);
  return true;
}

Wrench ClockedLoop::tick(const DeviceState& state) {
  if (!take_frames(state.time)) {
    has_ended_ = true;
    return {};
  }
  const double begin = monotonic_now();
  TickRecord& record = newest_.draft();
  record = pipeline_.tick(state, {.is_force_requested = wants_force_.exchange(false)});
  const double took = monotonic_now() - begin;
  record.compute_nanoseconds = nanoseconds(took);
  times_.haptic_compute.record(record.compute_nanoseconds);
  times_.contact_compute.record(record.compute_nanoseconds);
  if (record.contact_number > 0) {
    times_.contact_age.record(nanoseconds(record.contact_age));
    times_.sensor_to_force.record(nanoseconds(record.sensor_age));
  }
  const double tick_seconds = 1 / device_.info().rate;
  if (took > tick_seconds) ++report_.num_missed;
  ++report_.num_ticks;
  report_.seconds = record.time + tick_seconds;
  if (pipeline_.contact().number > contact_number_) {
    contact_number_ = report_.num_contacts = pipeline_.contact().number;
    if (observer_.on_contact) observer_.on_contact(pipeline_.contact());
  }
  if (observer_.on_ticks) observer_.on_ticks({&record, 1});
  report_.num_faults = record.safety.num_faults;
  // On this clock nobody needs the force: the run ends rather than mixes two backends.
  if (status_ = pipeline_.status(); !status_) has_ended_ = true;
  const Wrench F_H_B = record.F_H_B;
  newest_.publish();
  return F_H_B;
}

void ClockedLoop::make_pictures() {
  const ContactRecord& contact = pipeline_.contact();
  for (std::size_t who = 0; who < kNumPictureConsumers; ++who) {
    if (!wants_contact_[who].exchange(false)) continue;
    ContactPicture& picture = contacts_[who].draft();
    picture.contact_number = contact.number;
    picture.frame_number = contact.frame_number;
    picture.X_WT = contact.X_WT;
    picture.bodies = contact.bodies;
    picture.spheres.resize(pipeline_.query().index()->tool().spheres().size());
    pipeline_.query().measure(pipeline_.cameras(), contact.X_WT, picture.spheres.wants());
    contacts_[who].publish();
  }
  if (wants_surface_.exchange(false)) {
    make_surface_picture(pipeline_.newest_cloud(), cameras_.front().newest, surfaces_.draft());
    surfaces_.publish();
  }
}

std::optional<TickRecord> ClockedLoop::latest() noexcept {
  if (!newest_.refresh()) return std::nullopt;
  return newest_.value();
}

LoopReport ClockedLoop::report() const {
  const std::lock_guard lock(mutex_);
  LoopReport report = report_;
  report.notes = pipeline_.notes();
  return report;
}

Status ClockedLoop::status() const {
  const std::lock_guard lock(mutex_);
  return status_;
}

RunSettings ClockedLoop::settings() const {
  const std::lock_guard lock(mutex_);
  return pipeline_.settings();
}

Status ClockedLoop::change(const RunSettings& settings) {
  const std::lock_guard lock(mutex_);
  if (!is_running_) return Error{Errc::unavailable, "the run has ended"};
  if (settings.contact_rate != pipeline_.settings().contact_rate) {
    return Error{Errc::invalid_argument,
                 "loop.contact_rate is the rate of ticks on a simulated clock, which stays what it "
                 "was at the start; start another run with it"};
  }
  if (const Status status = pipeline_.change(settings); !status) return status;
  if (observer_.on_settings) observer_.on_settings(pipeline_.revision(), settings);
  return Done{};
}

void ClockedLoop::hold_frames(bool is_held) noexcept {
  const std::lock_guard lock(mutex_);
  is_held_ = is_held;
  num_steps_ = 0;
  has_changed_.notify_all();
}

void ClockedLoop::step_frame() noexcept {
  const std::lock_guard lock(mutex_);
  ++num_steps_;
  has_changed_.notify_all();
}

}  // namespace

Result<std::unique_ptr<RunLoop>> RunLoop::simulate(const Tool& tool, const DepthSources& sources,
                                                   SteppedDevice& device,
                                                   const RunSettings& settings,
                                                   const SimulatedClock& clock,
                                                   RunObserver observer) {
  auto pipeline = Pipeline::create(tool, sources.infos(), device.info(), settings);
  if (!pipeline) return pipeline.error();
  return std::unique_ptr<RunLoop>(std::make_unique<ClockedLoop>(
      sources, device, std::move(observer), clock, *std::move(pipeline)));
}

}}  // namespace palpate::v0
