#include <cmath>
#include <string>
#include <utility>

#include "palpate/session/session.h"
#include "src/session/run_loop.h"

namespace palpate {
namespace {

/// Reads one frame ahead, so that the end of the stream is known while its last frame is current.
class FrameQueue {
 public:
  explicit FrameQueue(DepthSource& source) : source_(source) {}

  Status start() {
    if (const Status status = read(); !status) return status;
    if (!has_upcoming_) {
      return Error{Errc::bad_input,
                   source_.info().name + " holds no frame; give a source that does"};
    }
    first_time_ = upcoming_.timestamp;
    return Done{};
  }

  /// Moves to the newest frame that is not later than `time`; true if that is a new one.
  Result<bool> advance(double time) {
    bool fresh = false;
    while (has_upcoming_ && upcoming_.timestamp - first_time_ <= time) {
      std::swap(current_, upcoming_);
      fresh = true;
      if (const Status status = read(); !status) return status.error();
    }
    return fresh;
  }

  const DepthFrame& current() const { return current_; }
  double current_time() const { return current_.timestamp - first_time_; }
  /// The last frame has had its share of time.
  bool ended(double time) const {
    return !has_upcoming_ && time >= current_time() + 1 / source_.info().rate;
  }

 private:
  Status read() {
    const auto got = source_.next(upcoming_);
    if (!got) return got.error();
    has_upcoming_ = *got;
    if (!has_upcoming_) return Done{};
    const auto bad = [&](const std::string& what) {
      return Error{Errc::bad_input,
                   source_.info().name + ": frame " + std::to_string(num_read_) + " " + what};
    };
    const DepthStreamInfo& info = source_.info();
    if (upcoming_.width != info.width || upcoming_.height != info.height) {
      return bad("has another size than the first one; all frames must have one size");
    }
    if (!std::isfinite(upcoming_.timestamp) ||
        (num_read_ > 0 && !(upcoming_.timestamp > last_time_))) {
      return bad("is not later than the one before; sort the frames by their time stamps");
    }
    last_time_ = upcoming_.timestamp;
    ++num_read_;
    return Done{};
  }

  DepthSource& source_;
  DepthFrame current_, upcoming_;
  bool has_upcoming_ = false;
  double first_time_ = 0, last_time_ = 0;
  int num_read_ = 0;
};

Error too_long() {
  return {Errc::invalid_argument, "a run has at most " + std::to_string(kMaxTicks) +
                                      " ticks; choose a shorter duration or a lower rate"};
}

}  // namespace

Result<RunLog> run_session(const Tool& tool, DepthSource& source, const PoseFunction& X_WT,
                           const RunSettings& settings, const RunCallbacks& callbacks) {
  auto session = Session::create(tool, source.info(), settings);
  if (!session) return session.error();
  return run_loop(*session, source, X_WT, callbacks);
}

Result<RunLog> run_loop(Session& session, DepthSource& source, const PoseFunction& X_WT,
                        const RunCallbacks& callbacks) {
  const RunSettings& settings = session.settings();
  RunLog log;
  log.settings = settings;
  log.why_not_cuda = session.why_not_cuda();
  log.stream = source.info();
  if (std::isfinite(settings.duration)) {
    const double num_ticks = std::ceil(settings.duration * settings.rate);
    if (num_ticks > static_cast<double>(kMaxTicks)) return too_long();
    log.ticks.reserve(static_cast<std::size_t>(num_ticks));
  }
  FrameQueue frames(source);
  if (const Status status = frames.start(); !status) return status.error();
  if (callbacks.on_session) callbacks.on_session(session);

  double deepest = -1;
  int deepest_frame = -1;
  for (std::size_t k = 0;; ++k) {
    const double time = static_cast<double>(k) / settings.rate;
    if (time >= settings.duration) break;
    if (k == kMaxTicks) return too_long();
    const auto fresh = frames.advance(time);
    if (!fresh) return fresh.error();
    if (settings.end_with_source && frames.ended(time)) break;
    if (*fresh) {
      if (callbacks.on_frame) {
        const Status status =
            callbacks.on_frame(log.frames.size(), frames.current_time(), frames.current());
        if (!status) return status.error();
      }
      log.frames.push_back(session.take_frame(frames.current(), frames.current_time()));
    }
    const TickRecord& tick = log.ticks.emplace_back(session.tick(time, X_WT(k, time)));
    if (tick.penetration.volume > deepest) {
      deepest = tick.penetration.volume;
      log.deepest_tick = k;
      if (deepest_frame != tick.frame) log.deepest_frame = frames.current();
      deepest_frame = tick.frame;
    }
    if (callbacks.on_tick && !callbacks.on_tick(tick)) {
      log.interrupted = true;
      break;
    }
    if (session.is_faded_out()) {
      log.failure = session.status().error().message;
      break;
    }
  }
  return log;
}

}  // namespace palpate
