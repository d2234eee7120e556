#include <algorithm>
#include <chrono>
#include <condition_variable>
#include <mutex>
#include <utility>

#include "palpate/viewer/views.h"
#include "src/viewer/command.h"
#include "src/viewer/samples.h"
#include "src/viewer/shown.h"
#include "src/viewer/stages.h"
#include "src/viewer/view_clock.h"

namespace palpate {
namespace {

using Json = nlohmann::ordered_json;

constexpr double kPicturePeriod = 1.0 / 30;  // s
constexpr double kMostBehind = 0.25;         // s; what is later is not made up for
constexpr double kMostSteps = 1000;
constexpr std::chrono::milliseconds kLongestWait{20};

class PathViewImpl final : public PathView {
 public:
  PathViewImpl(const Tool& tool, const DepthStreamInfo& stream, std::string title)
      : content_{"live", std::move(title), &tool, stream} {}

  RunCallbacks callbacks(std::function<bool()> keep_going) override;
  void end() override;

  const ViewContent& content() const override { return content_; }
  void poll(const ViewWishes& wishes, ViewUpdate& update) override;
  std::string state() override;
  std::string controls() override { return "[]"; }
  Result<std::string> command(std::string_view json) override;

 private:
  void take_session(const Session& session);
  void take_frame(std::size_t index, double time, const DepthFrame& frame);
  bool wait_after(const TickRecord& tick, const std::function<bool()>& keep_going);
  void make_pictures(const TickRecord& tick);

  const ViewContent content_;

  // Of the thread of the run.
  const Session* session_ = nullptr;
  ForceScale scale_;
  double tick_seconds_ = 1e-3, next_picture_ = 0;

  LatencyHistogram query_times_;
  std::mutex mutex_;  // of what follows
  std::condition_variable has_changed_;
  ViewClock clock_;
  int num_steps_ = 0;  // frames until it pauses; 0: it does not
  ViewWishes wishes_;
  bool has_ended_ = false, needs_surface_ = false, needs_contact_ = false;
  std::uint64_t num_frames_ = 0, num_ticks_ = 0;
  double time_ = 0;
  ViewUpdate news_;  // newest wins; samples in their queue
  SampleQueue samples_;
};

RunCallbacks PathViewImpl::callbacks(std::function<bool()> keep_going) {
  RunCallbacks callbacks;
  callbacks.on_session = [this](const Session& session) { take_session(session); };
  callbacks.on_frame = [this](std::size_t index, double time, const DepthFrame& frame) -> Status {
    take_frame(index, time, frame);
    return Done{};
  };
  callbacks.on_tick = [this, keep_going = std::move(keep_going)](const TickRecord& tick) {
    return wait_after(tick, keep_going);
  };
  return callbacks;
}

void PathViewImpl::take_session(const Session& session) {
  session_ = &session;
  tick_seconds_ = 1 / session.settings().rate;
  scale_ = force_shown(*content_.tool, session.settings().contact);
  const std::lock_guard lock(mutex_);
  clock_.set(0);
}

void PathViewImpl::end() {
  const std::lock_guard lock(mutex_);
  has_ended_ = true;
}

void PathViewImpl::take_frame(std::size_t index, double time, const DepthFrame& frame) {
  auto copy = std::make_shared<const ViewFrame>(ViewFrame{index, time, frame});
  const std::lock_guard lock(mutex_);
  news_.frame = std::move(copy);
  num_frames_ = index + 1;
  needs_surface_ = true;
  if (num_steps_ > 0 && --num_steps_ == 0) {
    clock_.pause();
    clock_.set(time);
  }
}

/// The contact thirty times a second, and each surface once. The session stands still meanwhile.
void PathViewImpl::make_pictures(const TickRecord& tick) {
  const double now = monotonic_now();
  ViewWishes wishes;
  {
    const std::lock_guard lock(mutex_);
    wishes.contacts = wishes_.contacts && needs_contact_ && now >= next_picture_;
    wishes.surfaces = wishes_.surfaces && needs_surface_;
  }
  const auto number = static_cast<std::uint64_t>(tick.frame);
  ViewUpdate made;
  if (wishes.contacts) {
    next_picture_ = now + kPicturePeriod;
    made.contact = std::make_shared<const ViewContact>(
        contact_shown(session_->query(), tick.X_WT, tick.time, number));
  }
  if (wishes.surfaces) {
    made.surface = std::make_shared<const ViewSurface>(
        surface_shown(session_->newest_cloud(), session_->moment_at(tick.time).to.cloud, number));
  }
  const std::lock_guard lock(mutex_);
  if (made.contact) {
    news_.contact = std::move(made.contact);
    needs_contact_ = false;
  }
  if (made.surface) {
    news_.surface = std::move(made.surface);
    needs_surface_ = false;
  }
}

/// Until the time of the next tick.
bool PathViewImpl::wait_after(const TickRecord& tick, const std::function<bool()>& keep_going) {
  query_times_.record(static_cast<std::int64_t>(1e9 * tick.query_seconds));
  std::unique_lock lock(mutex_);
  samples_.add(sample_shown(tick.time, tick.X_WT, tick.penetration.measure_W,
                            tick.penetration.volume, tick.query_seconds, scale_));
  time_ = tick.time;
  ++num_ticks_;
  needs_contact_ = true;
  const double next = tick.time + tick_seconds_;
  for (;;) {
    lock.unlock();
    make_pictures(tick);
    if (keep_going && !keep_going()) return false;
    lock.lock();
    const double ahead = next - clock_.now();
    if (!clock_.is_paused() && ahead <= 0) {
      if (ahead < -kMostBehind) clock_.set(next);
      return true;
    }
    const std::chrono::duration<double> wait(ahead / clock_.speed());
    if (clock_.is_paused() || wait > kLongestWait) {
      has_changed_.wait_for(lock, kLongestWait);
    } else {
      has_changed_.wait_for(lock, wait);
    }
  }
}

void PathViewImpl::poll(const ViewWishes& wishes, ViewUpdate& update) {
  const std::lock_guard lock(mutex_);
  wishes_ = wishes;
  if (wishes.frames) update.frame = std::exchange(news_.frame, nullptr);
  if (wishes.contacts) update.contact = std::exchange(news_.contact, nullptr);
  if (wishes.surfaces) update.surface = std::exchange(news_.surface, nullptr);
  if (wishes.samples) samples_.take(update.samples);
}

std::string PathViewImpl::state() {
  const std::lock_guard lock(mutex_);
  Json note;
  if (has_ended_) {
    note = "the run has ended; palpate view with the folder of the run shows it again";
  } else if (clock_.is_paused()) {
    note = "the run is paused";
  }
  return Json{{"time", time_},
              {"running", !has_ended_},
              {"fault", nullptr},
              {"note", note},
              {"paused", clock_.is_paused()},
              {"revision", 0},
              {"settings", Json::object()},
              {"frame_number", num_frames_ > 0 ? num_frames_ - 1 : 0},
              {"ticks", num_ticks_},
              {"missed", 0},
              {"lost", 0},
              {"frames", num_frames_},
              {"contacts", num_ticks_},
              {"sensor_age", 0},
              {"speed", clock_.speed()},
              {"stages", {stage_json("contact", query_times_)}}}
      .dump();
}

Result<std::string> PathViewImpl::command(std::string_view json) {
  const auto command = ViewCommand::parse(json);
  if (!command) return command.error();
  const std::string& name = command->name();
  const auto num_steps = command->number("frames", 1, kMostSteps, 1);
  if (name == "step" && !num_steps) return num_steps.error();
  const auto factor = command->number("factor", ViewClock::kSlowest, ViewClock::kFastest);
  if (name == "speed" && !factor) return factor.error();
  const std::lock_guard lock(mutex_);
  if (has_ended_) return Error{Errc::unavailable, "the run has ended"};
  if (name == "pause") {
    num_steps_ = 0;
    clock_.pause();
  } else if (name == "resume") {
    num_steps_ = 0;
    clock_.resume();
  } else if (name == "step") {
    num_steps_ += static_cast<int>(*num_steps);
    clock_.resume();
  } else if (name == "speed") {
    clock_.set_speed(*factor);
  } else {
    return command->unknown("show, get, pause, resume, step and speed");
  }
  has_changed_.notify_all();
  return std::string("{}");
}

}  // namespace

std::unique_ptr<PathView> PathView::create(const Tool& tool, const DepthStreamInfo& stream,
                                           std::string title) {
  return std::make_unique<PathViewImpl>(tool, stream, std::move(title));
}

}  // namespace palpate
