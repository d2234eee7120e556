#include "src/run/loop/surface_stage.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <new>
#include <string>
#include <utility>

#include "src/core/internal/guarded.h"
#include "src/core/internal/monotonic_clock.h"
#include "src/core/internal/thread_rank.h"
#include "src/field/internal/needed_window.h"
#include "src/run/internal/pipeline.h"
#include "src/run/internal/surface_picture.h"

namespace palpate { inline namespace v0 {
namespace {

constexpr double kFirstFrameTimeout = 10;        // s
constexpr std::size_t kNumFramesToPublish = 32;  // a second
constexpr double kUsualPeriod = 1.0 / 30;        // s, where the stream says none
/// Longest use of a surface, frame periods from the start of making it: until the next one has been
/// made and blended in, and the one after that is made.
constexpr double kMaxPeriods = 3;
/// Longest blend, s, or three frames if they are longer: the next surface waits for it.
constexpr double kLongestBlend = 0.25;
constexpr double kLaterThanAll = std::numeric_limits<double>::infinity();

void take_surface_rank() { take_rank(ThreadRank::surface); }

DepthFrame blank_frame(const DepthStreamInfo& stream) {
  DepthFrame frame;
  frame.width = stream.width;
  frame.height = stream.height;
  frame.pixels.resize(static_cast<std::size_t>(stream.width) *
                      static_cast<std::size_t>(stream.height));
  if (stream.has_flow) frame.flow.resize(2 * frame.pixels.size());
  return frame;
}

/// Returns a stream whose frames have room for those of each camera.
DepthStreamInfo largest_of(const DepthSources& sources) {
  DepthStreamInfo largest;
  for (const DepthSource* source : sources) {
    largest.width = std::max(largest.width, source->info().width);
    largest.height = std::max(largest.height, source->info().height);
    largest.has_flow = largest.has_flow || source->info().has_flow;
  }
  return largest;
}

/// Returns the window options; no window if objects move, which can be anywhere.
WindowOptions window_of(const RunSettings& settings) {
  WindowOptions window = settings.window;
  window.enabled = window.enabled && !has_moving_objects(settings);
  return window;
}

}  // namespace

ToolBall ball_of(const Tool& tool) {
  constexpr double kMaxBallGrowth = 1.5;  // largest growth of a ball that is split into parts
  ToolBall ball{tool.sphere_mass().center_of_mass, 0};
  for (const Sphere& sphere : tool.spheres()) {
    const double away = norm(to_double(sphere.center) - ball.p_TC);
    ball.reach = std::max(ball.reach, away + kMaxBallGrowth * static_cast<double>(sphere.radius));
  }
  return ball;
}

SurfaceStage::Camera::Camera(DepthSource& from, SurfaceTimeline into)
    : source(from),
      timeline(std::move(into)),
      period(from.info().rate > 0 ? 1 / from.info().rate : kUsualPeriod),
      frames(TimedFrame{blank_frame(from.info())}) {}

SurfaceStage::SurfaceStage(const DepthSources& sources, std::vector<SurfaceTimeline> timelines,
                           const RunSettings& settings, const ToolBall& tool, bool keeps_frames,
                           LatencyHistogram& surface_compute)
    : pool_(num_threads_for(settings.num_threads),
            settings.wants_real_time ? take_surface_rank : nullptr),
      surface_compute_(surface_compute),
      keeps_frames_(keeps_frames),
      wants_real_time_(settings.wants_real_time),
      window_(window_of(settings)),
      tool_(tool),
      seen_(keeps_frames ? kNumFramesToPublish * sources.size() : 0,
            PublishedFrame{blank_frame(largest_of(sources))}),
      motion_scale_(settings.coupling.motion_scale) {
  for (std::size_t k = 0; k < sources.size(); ++k) {
    cameras_.push_back(std::make_unique<Camera>(sources[k], std::move(timelines[k])));
  }
}

Status SurfaceStage::start() {
  for (std::size_t k = 0; k < cameras_.size(); ++k) {
    cameras_[k]->thread = std::thread(
        [this, k] { guarded([&] { read_frames(k); }, [&](const Error& error) { fail(error); }); });
  }
  surface_thread_ = std::thread(
      [this] { guarded([&] { make_surfaces(); }, [&](const Error& error) { fail(error); }); });
  for (const auto& camera : cameras_) {
    if (const Status seen = wait_for_first(*camera); !seen) return seen;
  }
  return Done{};
}

Status SurfaceStage::wait_for_first(const Camera& camera) {
  const std::string& name = camera.source.info().name;
  const double begin = monotonic_now();
  while (camera.num_made.load(std::memory_order_acquire) == 0) {
    if (const Status now = status(); !now) return now;
    if (has_backend_failed()) return lost_backend();
    if (has_source_ended() && camera.num_read.load() == 0) {
      return Error{Errc::bad_input, name + " has no frames; give a source that does"};
    }
    if (monotonic_now() - begin > kFirstFrameTimeout) {
      return Error{Errc::unavailable, name + " has sent no frame within " +
                                          std::to_string(static_cast<int>(kFirstFrameTimeout)) +
                                          " s; check the sensor and its cable"};
    }
    if (stop_.sleep_for(0.001)) break;
  }
  return Done{};
}

void SurfaceStage::stop() noexcept {
  stop_.stop();
  for (const auto& camera : cameras_) camera->source.cancel();
  event_.ring();
  for (const auto& camera : cameras_) {
    if (camera->thread.joinable()) camera->thread.join();
  }
  if (surface_thread_.joinable()) surface_thread_.join();
}

/// Keeps the first error of a source; the force fades out, as no surface comes any more.
void SurfaceStage::fail(const Error& error) {
  const std::lock_guard lock(error_mutex_);
  source_failed_.store(true, std::memory_order_release);
  if (status_) status_ = error;
}

Status SurfaceStage::status() const {
  const std::lock_guard lock(error_mutex_);
  return status_;
}

std::uint64_t SurfaceStage::num_read() const noexcept {
  std::uint64_t sum = 0;
  for (const auto& camera : cameras_) sum += camera->num_read.load(std::memory_order_acquire);
  return sum;
}

std::uint64_t SurfaceStage::num_late() const noexcept {
  std::uint64_t sum = 0;
  for (const auto& camera : cameras_) sum += camera->source.num_late();
  return sum;
}

std::uint64_t SurfaceStage::num_skipped() const noexcept {
  std::uint64_t sum = 0;
  for (const auto& camera : cameras_) {
    // The newest frame may still be in progress.
    const std::uint64_t read = camera->num_read.load(), made = camera->num_made.load();
    if (read > made + 1) sum += read - made - 1;
  }
  return sum;
}

void SurfaceStage::read_frames(std::size_t number) {
  Camera& camera = *cameras_[number];
  TimedFrame newest{blank_frame(camera.source.info())};
  while (!stop_.is_stopping()) {
    if (may_read(camera)) {
      const auto got = camera.source.read(newest.frame);
      if (!got) {
        if (stop_.is_stopping()) return;  // a cancelled source has not failed
        const std::string& name = camera.source.info().name;
        return fail(error_of_camera(got.error(), name, number, cameras_.size()));
      }
      if (!*got) break;
      // Frames that were held have moved time on.
      newest.capture_time = std::max(camera.source.capture_time(newest.frame, monotonic_now()),
                                     std::nextafter(newest.capture_time, kLaterThanAll));
    } else {
      newest.capture_time = std::max(newest.capture_time + camera.period, monotonic_now());
      newest.frame.flow.clear();  // a held frame stands still
    }
    if (stop_.sleep_for(newest.capture_time - monotonic_now())) return;
    camera.frames.draft() = newest;
    camera.num_read.fetch_add(1, std::memory_order_release);
    camera.frames.publish();
    event_.ring();
  }
  // The last frame has its share of time.
  stop_.sleep_for(camera.num_read.load() > 0 ? camera.period : 0);
  // One that was cancelled has not ended.
  int none = -1;
  if (!stop_.is_stopping()) ended_camera_.compare_exchange_strong(none, static_cast<int>(number));
}

/// True if the next frame is to be read; false: the last one is repeated.
bool SurfaceStage::may_read(Camera& camera) {
  if (!is_held_.load()) {
    camera.num_stepped = num_steps_.load();
    return true;
  }
  if (camera.num_stepped == num_steps_.load()) return camera.num_read.load() == 0;
  ++camera.num_stepped;
  return true;
}

/// Returns the next camera in turn with a new frame and a free surface; null at the end.
SurfaceStage::Camera* SurfaceStage::next_camera(std::size_t& last) {
  for (;;) {
    const std::uint32_t count = event_.count();
    if (stop_.is_stopping()) return nullptr;
    for (std::size_t i = 0; i < cameras_.size(); ++i) {
      const std::size_t k = (last + 1 + i) % cameras_.size();
      Camera& camera = *cameras_[k];
      const bool has_place = camera.num_made.load(std::memory_order_relaxed) <=
                             camera.num_taken.load(std::memory_order_acquire) + kNumSpare - 1;
      if (!has_place || !camera.frames.refresh()) continue;
      last = k;
      return &camera;
    }
    event_.wait(count);
  }
}

/// Returns the pixels that the tool can reach until the surface made now is replaced.
PixelWindow SurfaceStage::next_window(Camera& camera, const Pose& X_WC, double time) {
  has_tool_ = tools_.refresh() || has_tool_;
  if (!has_tool_) return {};  // no hand holds one yet
  const Vec3d p_WQ = tools_.value() * tool_.p_TC;
  const Vec3d p_CQ = X_WC == Pose{} ? p_WQ : inverse(X_WC) * p_WQ;
  double speed = window_.speed * std::max(motion_scale_.load(), 1.0);
  if (camera.p_CQ && time > camera.tool_time) {
    speed = std::max(speed, 2 * norm(p_CQ - *camera.p_CQ) / (time - camera.tool_time));
  }
  camera.p_CQ = p_CQ;
  camera.tool_time = time;
  if (!window_.enabled) return {};
  const double way = speed * kMaxPeriods * std::max(camera.period, camera.timeline.period());
  const DepthStreamInfo& stream = camera.timeline.stream();
  return needed_window(stream.intrinsics, stream.width, stream.height, p_CQ, tool_.reach + way);
}

void SurfaceStage::make_surfaces() {
  if (wants_real_time_) nice_.store(take_rank(ThreadRank::surface));
  std::size_t index = cameras_.size() - 1;
  while (Camera* const camera = next_camera(index)) {
    make_surface(*camera, static_cast<std::uint32_t>(index));
  }
}

void SurfaceStage::make_surface(Camera& camera, std::uint32_t index) {
  const TimedFrame& newest = camera.frames.value();
  const std::uint64_t number = num_made_.load(std::memory_order_relaxed);
  const std::uint64_t camera_frame = camera.num_made.load(std::memory_order_relaxed);
  const double begin = monotonic_now();
  const std::uint32_t revision = take_change();
  SurfaceTimeline& timeline = camera.timeline;
  const SurfaceStats stats = timeline.push(newest.frame, newest.capture_time, pool_,
                                           next_window(camera, newest.frame.X_WC, begin));
  const double end = monotonic_now();
  surface_compute_.record(static_cast<std::int64_t>(1e9 * (end - begin)));
  // A change may bring another timeline.
  backend_failed_.store(!timeline.status(), std::memory_order_release);
  if (!timeline.status()) return;
  const SurfaceBlend blend = timeline.at(newest.capture_time);
  LiveSurfaces& made = camera.surfaces.draft();
  made.blend = blend;
  made.key_frames = timeline.key_frames();
  made.ready_time = end;
  made.capture_time = newest.capture_time;
  made.period = std::min(timeline.period(), std::max(kLongestBlend, 3 * camera.period));
  made.frame_number = number;
  made.camera_frame = camera_frame;
  made.revision = revision;
  camera.surfaces.publish();
  if (PublishedFrame* seen = keeps_frames_ ? seen_.draft() : nullptr) {
    seen->frame = newest.frame;
    FrameRecord& record = seen->record = {};
    record.number = number;
    record.camera = index;
    record.camera_frame = camera_frame;
    record.revision = revision;
    record.capture_time = newest.capture_time;
    record.source_time = newest.frame.timestamp;
    record.unit = newest.frame.unit;
    record.X_WC = newest.frame.X_WC;
    record.surface = stats;
    record.requested = blend.to.field.requested;
    record.compute_nanoseconds = static_cast<std::int64_t>(1e9 * (end - begin));
    record.period = timeline.period();
    seen_.push();
  }
  camera.num_made.store(camera_frame + 1, std::memory_order_release);
  num_made_.store(number + 1, std::memory_order_release);
  if (index == 0 && wants_picture_.exchange(false)) make_picture(number);
}

/// Takes a change if there is one; returns the revision of the next surface.
std::uint32_t SurfaceStage::take_change() {
  if (SurfaceChange* const change = changes_.look()) {
    for (std::size_t k = 0; k < cameras_.size(); ++k) {
      std::swap(cameras_[k]->timeline, change->timelines[k]);
    }
    revision_.store(change->revision);
    backend_failed_.store(false, std::memory_order_release);
    changes_.settle();
  }
  return revision_.load();
}

void SurfaceStage::make_picture(std::uint64_t number) {
  try {
    make_surface_picture(cameras_.front()->timeline.newest_cloud(pool_), number, pictures_.draft());
    pictures_.publish();
  } catch (const std::bad_alloc&) {
    // Too little memory: no picture.
  }
}

bool SurfaceStage::take(std::size_t camera) noexcept {
  Camera& from = *cameras_[camera];
  if (!from.surfaces.refresh()) return false;
  from.num_taken.store(from.surfaces.value().camera_frame + 1, std::memory_order_release);
  event_.ring();
  return true;
}

}}  // namespace palpate::v0
