#include "src/run/loop/surface_stage.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <new>
#include <string>
#include <utility>

#include "src/core/monotonic_clock.h"
#include "src/core/thread_rank.h"
#include "src/field/internal/asked_window.h"
#include "src/run/internal/pipeline.h"

namespace palpate {
namespace {

constexpr double kFirstFrameTimeout = 10;        // s
constexpr std::size_t kNumFramesToPublish = 32;  // a second
constexpr double kUsualPeriod = 1.0 / 30;        // s, where the stream says none
/// Frame periods from the begin of a surface to the moment when nobody looks at it any more: until
/// the next one is made, or that one has been blended in and the one after that is made.
constexpr double kMostPeriods = 3;
constexpr double kLaterThanAll = std::numeric_limits<double>::infinity();

void take_surface_rank() { take_rank(ThreadRank::surface); }

DepthFrame blank_frame(const DepthStreamInfo& stream) {
  DepthFrame frame;
  frame.width = stream.width;
  frame.height = stream.height;
  frame.pixels.resize(static_cast<std::size_t>(stream.width) *
                      static_cast<std::size_t>(stream.height));
  return frame;
}

}  // namespace

ToolBall ball_of(const Tool& tool) {
  constexpr double kFelt = 1.5;  // a ball is felt so much larger at most, in parts inside of that
  ToolBall ball{tool.sphere_mass().centre_of_mass, 0};
  for (const Sphere& sphere : tool.spheres()) {
    const double away = norm(to_double(sphere.centre) - ball.p_TC);
    ball.reach = std::max(ball.reach, away + kFelt * static_cast<double>(sphere.radius));
  }
  return ball;
}

SurfaceStage::SurfaceStage(DepthSource& source, SurfaceTimeline timeline,
                           const RunSettings& settings, const ToolBall& tool, bool keeps_frames,
                           LatencyHistogram& surface_compute)
    : source_(source),
      timeline_(std::move(timeline)),
      pool_(settings.num_threads, settings.wants_real_time ? take_surface_rank : nullptr),
      surface_compute_(surface_compute),
      keeps_frames_(keeps_frames),
      wants_real_time_(settings.wants_real_time),
      period_(source.info().rate > 0 ? 1 / source.info().rate : kUsualPeriod),
      window_(settings.window),
      tool_(tool),
      frames_(TimedFrame{blank_frame(source.info())}),
      seen_(keeps_frames ? kNumFramesToPublish : 0, SeenFrame{blank_frame(source.info())}) {}

Status SurfaceStage::start() {
  sensor_thread_ = std::thread([this] {
    try {
      read_frames();
    } catch (const std::bad_alloc&) {
      fail(out_of_memory(), source_failed_);
    }
  });
  surface_thread_ = std::thread([this] { make_surfaces(); });
  const double begin = monotonic_now();
  while (num_frames() == 0) {
    if (const Status now = status(); !now) return now;
    if (has_backend_failed()) return lost_backend();
    if (has_source_ended() && num_read_.load() == 0) {
      return Error{Errc::bad_input,
                   source_.info().name + " holds no frame; give a source that does"};
    }
    if (monotonic_now() - begin > kFirstFrameTimeout) {
      return Error{Errc::unavailable, source_.info().name + " has sent no frame within " +
                                          std::to_string(static_cast<int>(kFirstFrameTimeout)) +
                                          " s; check the sensor and its cable"};
    }
    if (stop_.sleep_for(0.001)) break;
  }
  return Done{};
}

void SurfaceStage::stop() noexcept {
  stop_.stop();
  source_.cancel();
  bell_.ring();
  if (sensor_thread_.joinable()) sensor_thread_.join();
  if (surface_thread_.joinable()) surface_thread_.join();
}

void SurfaceStage::fail(const Error& error, std::atomic<bool>& flag) {
  {
    const std::lock_guard lock(error_mutex_);
    if (status_) status_ = error;
  }
  flag.store(true, std::memory_order_release);
}

Status SurfaceStage::status() const {
  const std::lock_guard lock(error_mutex_);
  return status_;
}

std::uint64_t SurfaceStage::num_skipped() const noexcept {
  // The newest frame may be in work.
  const std::uint64_t read = num_read_.load(), made = num_frames();
  return read > made + 1 ? read - made - 1 : 0;
}

void SurfaceStage::read_frames() {
  TimedFrame newest{blank_frame(source_.info())};
  while (!stop_.is_stopping()) {
    if (may_read()) {
      const auto got = source_.read(newest.frame);
      if (!got) return fail(got.error(), source_failed_);
      if (!*got) break;
      // Frames that were held have moved time on.
      newest.capture_time = std::max(source_.capture_time(newest.frame, monotonic_now()),
                                     std::nextafter(newest.capture_time, kLaterThanAll));
    } else {
      newest.capture_time = std::max(newest.capture_time + period_, monotonic_now());
    }
    if (stop_.sleep_for(newest.capture_time - monotonic_now())) return;
    frames_.draft() = newest;
    num_read_.fetch_add(1, std::memory_order_release);
    frames_.publish();
    bell_.ring();
  }
  // The last frame has its share of time.
  stop_.sleep_for(num_read_.load() > 0 ? period_ : 0);
  // One that was cancelled has not ended.
  if (!stop_.is_stopping()) source_ended_.store(true, std::memory_order_release);
}

/// Whether the next frame is to come, not the last one again.
bool SurfaceStage::may_read() {
  if (!is_held_.load()) {
    num_stepped_ = num_steps_.load();
    return true;
  }
  if (num_stepped_ == num_steps_.load()) return num_read_.load() == 0;
  ++num_stepped_;
  return true;
}

/// The newest frame, once its surface has a place; null at the end.
const SurfaceStage::TimedFrame* SurfaceStage::next_frame() {
  for (;;) {
    const std::uint32_t heard = bell_.count();
    if (stop_.is_stopping()) return nullptr;
    const bool has_place = num_made_.load(std::memory_order_relaxed) <=
                           num_taken_.load(std::memory_order_acquire) + kNumSpare - 1;
    if (has_place && frames_.refresh()) return &frames_.value();
    bell_.wait(heard);
  }
}

/// Where the tool can be until the surface that is made now is replaced.
PixelWindow SurfaceStage::next_window(double time) {
  if (!tools_.refresh() && !p_WC_) return {};  // nobody holds a tool yet
  const Vec3d p_WC = tools_.value() * tool_.p_TC;
  double speed = window_.speed;
  if (p_WC_ && time > tool_time_) {
    speed = std::max(speed, 2 * norm(p_WC - *p_WC_) / (time - tool_time_));
  }
  p_WC_ = p_WC;
  tool_time_ = time;
  if (!window_.enabled) return {};
  const double way = speed * kMostPeriods * std::max(period_, timeline_.period());
  const DepthStreamInfo& stream = timeline_.stream();
  return asked_window(stream.intrinsics, stream.width, stream.height, p_WC, tool_.reach + way);
}

void SurfaceStage::make_surfaces() {
  if (wants_real_time_) nice_.store(take_rank(ThreadRank::surface));
  for (std::uint64_t number = 0;;) {
    const TimedFrame* const newest = next_frame();
    if (newest == nullptr) return;
    const double begin = monotonic_now();
    const std::uint32_t revision = take_change();
    const SurfaceStats stats =
        timeline_.push(newest->frame, newest->capture_time, pool_, next_window(begin));
    const double end = monotonic_now();
    surface_compute_.record(static_cast<std::int64_t>(1e9 * (end - begin)));
    // It may pass: another timeline comes by a change.
    backend_failed_.store(!timeline_.status(), std::memory_order_release);
    if (!timeline_.status()) continue;
    const SurfaceBlend moment = timeline_.at(newest->capture_time);
    surfaces_.publish({moment, end, newest->capture_time, timeline_.period(), number, revision});
    if (SeenFrame* seen = keeps_frames_ ? seen_.draft() : nullptr) {
      seen->frame = newest->frame;
      seen->record = {number,
                      revision,
                      newest->capture_time,
                      newest->frame.timestamp,
                      newest->frame.unit,
                      stats,
                      moment.to.field.asked,
                      static_cast<std::int64_t>(1e9 * (end - begin)),
                      timeline_.period()};
      seen_.push();
    }
    num_made_.store(number + 1, std::memory_order_release);
    if (wants_picture_.exchange(false)) make_picture(number);
    ++number;
  }
}

/// The revision that the next surface is made with.
std::uint32_t SurfaceStage::take_change() {
  if (SurfaceChange* const change = changes_.look()) {
    std::swap(timeline_, *change->timeline);
    revision_.store(change->revision);
    backend_failed_.store(false, std::memory_order_release);
    changes_.settle();
  }
  return revision_.load();
}

void SurfaceStage::make_picture(std::uint64_t number) {
  try {
    make_surface_picture(timeline_.newest_cloud(pool_), number, pictures_.draft());
    pictures_.publish();
  } catch (const std::bad_alloc&) {
    // There is no picture, then.
  }
}

bool SurfaceStage::take() noexcept {
  if (!surfaces_.refresh()) return false;
  num_taken_.store(surfaces_.value().frame_number + 1, std::memory_order_release);
  bell_.ring();
  return true;
}

}  // namespace palpate
