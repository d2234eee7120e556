#include "src/cameras/stream/camera_source.h"

#include <atomic>
#include <chrono>
#include <condition_variable>
#include <mutex>
#include <optional>
#include <set>
#include <string>
#include <thread>
#include <utility>

#include "src/cameras/internal/plausibility.h"
#include "src/cameras/stream/frame_intake.h"
#include "src/cloud/internal/frame_limits.h"
#include "src/core/internal/bounded_call.h"
#include "src/core/internal/guarded.h"
#include "src/core/internal/monotonic_clock.h"

namespace palpate { inline namespace v0 {
namespace {

using namespace std::string_literals;

constexpr char kNoRays[] = "has frames without positive, finite intrinsics";
constexpr int kMaxTold = 10;                           // losses of a camera
constexpr double kRetryPeriod = 0.5;                   // s
constexpr std::chrono::seconds kLongestVendorCall{2};  // at the end

/// Returns the format of output: that of the first image without distortion, or a part of it.
DepthStreamInfo pinhole_info(const DepthStreamInfo& stream, const CameraTruth& truth,
                             const CameraUri& uri) {
  DepthStreamInfo info = stream;
  const CameraModel raw = truth.model_of(stream, stream.width, stream.height);
  CameraModel pinhole{stream.width, stream.height, raw.intrinsics, {}};
  if (uri.is_cropped) pinhole = valid_part(pinhole, raw);
  info.width = pinhole.width;
  info.height = pinhole.height;
  info.intrinsics = pinhole.intrinsics;
  info.distortion = {};
  if (truth.unit) info.unit = *truth.unit;
  info.sensor = uri.sensor.value_or(stream.sensor);
  return info;
}

CameraModel pinhole_of(const DepthStreamInfo& info) {
  return {info.width, info.height, info.intrinsics, {}};
}

class RectifiedSource final : public DepthSource {
 public:
  RectifiedSource(RawStream raw, const CameraTruth& truth, DepthStreamInfo info)
      : raw_(std::move(raw.source)),
        is_projected_(raw.X_FC.has_value()),
        truth_(truth),
        info_(std::move(info)),
        rectifier_(pinhole_of(info_)) {}

  const DepthStreamInfo& info() const override { return info_; }
  void cancel() noexcept override { raw_->cancel(); }

  Result<bool> next(DepthFrame& frame) override {
    auto got = raw_->next(frame);
    if (!got || !*got) return got;
    if (truth_.unit) frame.unit = *truth_.unit;
    drop_far_codes(frame, info_.sensor);
    const CameraModel model = truth_.model_of(raw_->info(), frame.width, frame.height);
    if (!has_rays(model)) return Error{Errc::bad_input, info_.name + " " + kNoRays};
    if (const std::string doubt = doubts_.look(frame, model, is_projected_); !doubt.empty()) {
      const std::lock_guard lock(mutex_);
      notes_.push_back(info_.name + ": " + doubt);
    }
    rectifier_.apply(model, frame);
    return true;
  }

  std::vector<std::string> take_notes() override {
    std::vector<std::string> notes = raw_->take_notes();
    const std::lock_guard lock(mutex_);
    for (std::string& note : std::exchange(notes_, {})) notes.push_back(std::move(note));
    return notes;
  }

 private:
  const std::unique_ptr<DepthSource> raw_;
  const bool is_projected_;
  const CameraTruth truth_;
  const DepthStreamInfo info_;
  Rectifier rectifier_;
  Plausibility doubts_;
  std::mutex mutex_;
  std::vector<std::string> notes_;
};

/// Shared with the thread, which may outlive the source if a vendor's call never returns.
struct LiveCamera {
  LiveCamera(RawStream first, OpenRaw open, const CameraTruth& said, SensorKind kind,
             const FrameIntake::Options& options)
      : intake(options),
        again(std::move(open)),
        truth(said),
        sensor(kind),
        is_projected(first.X_FC.has_value()),
        raw(std::move(first.source)) {}

  void run();
  void read_all();
  bool reopen(const Error& why);
  void note_return();
  void close();
  /// Requires `mutex`. A note that a camera repeats each time it is opened is told once.
  void take_raw_notes() {
    constexpr std::size_t kMaxNotes = 100;
    for (const std::string& note : raw->take_notes()) {
      if (raw_notes.size() < kMaxNotes && raw_notes.insert(note).second) intake.add_note(note);
    }
  }

  FrameIntake intake;
  const OpenRaw again;
  const CameraTruth truth;
  const SensorKind sensor;
  const bool is_projected;
  // Members that only the thread uses.
  Plausibility doubts;
  bool has_no_rays = false;       // of some frames
  std::optional<double> lost_at;  // s, monotonic; until a frame has come again
  int num_losses = 0;

  // Guards the members below. Not held in a call into a vendor's library: `cancel` and `take_notes`
  // of raw streams make none.
  std::mutex mutex;
  std::condition_variable ended;
  std::unique_ptr<DepthSource> raw;
  std::set<std::string> raw_notes;  // so far
  bool has_ended = false, is_given_up = false;
};

void LiveCamera::run() {
  guarded([&] { read_all(); }, [&](const Error& error) { intake.end(error); });
  close();
  const std::lock_guard lock(mutex);
  if (is_given_up) count_hung_calls(-1);
  has_ended = true;
  ended.notify_all();
}

/// May take long, or never return: meanwhile there is no stream.
void LiveCamera::close() {
  std::unique_ptr<DepthSource> closing;
  {
    const std::lock_guard lock(mutex);
    closing = std::move(raw);
  }
}

void LiveCamera::read_all() {
  DepthFrame frame;
  for (;;) {
    const auto got = raw->next(frame);
    const double arrival = monotonic_now();
    {
      const std::lock_guard lock(mutex);
      take_raw_notes();
    }
    if (intake.is_cancelled()) break;
    if (!got) {
      if (reopen(got.error())) continue;
      break;
    }
    if (!*got) {
      intake.end(false);
      break;
    }
    note_return();
    if (truth.unit) frame.unit = *truth.unit;
    drop_far_codes(frame, sensor);
    const CameraModel model = truth.model_of(raw->info(), frame.width, frame.height);
    if (!has_rays(model)) {
      if (!std::exchange(has_no_rays, true)) intake.add_note(kNoRays + "; they are dropped"s);
      continue;
    }
    if (std::string doubt = doubts.look(frame, model, is_projected); !doubt.empty()) {
      intake.add_note(std::move(doubt));
    }
    intake.give(frame, model, arrival);
  }
}

/// Opens the camera again. False: the stream is over.
bool LiveCamera::reopen(const Error& why) {
  if (!again) {
    intake.end(why);
    return false;
  }
  if (!lost_at) {  // else it has been opened again, and nothing came
    lost_at = monotonic_now();
    if (++num_losses <= kMaxTold) {
      intake.add_note("was lost: " + why.message + "; it is tried again until it is back" +
                      (num_losses == kMaxTold ? "; from now on, that is not told" : ""));
    }
  }
  while (intake.sleep_for(kRetryPeriod)) {
    close();  // before it is opened again
    auto opened = again();
    if (!opened) continue;
    {
      const std::lock_guard lock(mutex);
      raw = std::move(opened->source);
    }
    intake.restart();
    return !intake.is_cancelled();
  }
  return false;
}

/// Notes that the camera is back; called with its first frame.
void LiveCamera::note_return() {
  if (!lost_at) return;
  const double seconds = monotonic_now() - *std::exchange(lost_at, std::nullopt);
  if (num_losses > kMaxTold) return;
  intake.add_note("is back after " + std::to_string(static_cast<int>(seconds + 0.5)) + " s");
}

class LiveSource final : public DepthSource {
 public:
  LiveSource(std::shared_ptr<LiveCamera> camera, DepthStreamInfo info)
      : camera_(std::move(camera)), info_(std::move(info)) {}

  ~LiveSource() override {
    cancel();
    if (!thread_.joinable()) return;
    std::unique_lock lock(camera_->mutex);
    const bool has_ended =
        camera_->ended.wait_for(lock, kLongestVendorCall, [&] { return camera_->has_ended; });
    camera_->is_given_up = !has_ended;
    if (!has_ended) count_hung_calls(1);
    lock.unlock();
    has_ended ? thread_.join() : thread_.detach();
  }

  Status start() {
    return start_thread(thread_, "that reads frames", [camera = camera_] { camera->run(); });
  }

  const DepthStreamInfo& info() const override { return info_; }
  Result<bool> next(DepthFrame& frame) override { return camera_->intake.next(frame); }
  void cancel() noexcept override {
    camera_->intake.cancel();
    const std::lock_guard lock(camera_->mutex);
    if (camera_->raw) camera_->raw->cancel();
  }
  std::vector<std::string> take_notes() override {
    {
      // Its thread sees them with the next frame, which may never come.
      const std::lock_guard lock(camera_->mutex);
      if (camera_->raw) camera_->take_raw_notes();
    }
    return camera_->intake.take_notes();
  }

 private:
  const std::shared_ptr<LiveCamera> camera_;
  const DepthStreamInfo info_;
  std::thread thread_;
};

}  // namespace

Result<CameraTruth> truth_of(const CameraUri& uri, const DepthStreamInfo& stream) {
  if (!uri.intrinsics && !(stream.intrinsics.fx > 0 && stream.intrinsics.fy > 0)) {
    return Error{
        Errc::invalid_argument,
        "camera " + uri.text + ": unknown intrinsics; pass ?intrinsics=fx,fy,cx,cy in pixels"};
  }
  return CameraTruth{uri.intrinsics, uri.distortion, uri.unit, {stream.width, stream.height}};
}

Result<std::unique_ptr<DepthSource>> make_rectified(RawStream raw, const CameraUri& uri) {
  const DepthStreamInfo& stream = raw.source->info();
  const auto truth = truth_of(uri, stream);
  if (!truth) return truth.error();
  DepthStreamInfo info = pinhole_info(stream, *truth, uri);
  const CameraModel seen = truth->model_of(stream, stream.width, stream.height);
  if (info.has_flow && !(seen == pinhole_of(info))) return flow_of_lens(info.name);
  return std::unique_ptr<DepthSource>(
      std::make_unique<RectifiedSource>(std::move(raw), *truth, std::move(info)));
}

Result<std::unique_ptr<DepthSource>> make_live(RawStream raw, OpenRaw again, const CameraUri& uri) {
  const auto truth = truth_of(uri, raw.source->info());
  if (!truth) return truth.error();
  DepthStreamInfo info = pinhole_info(raw.source->info(), *truth, uri);
  info.is_live = true;
  info.num_frames = {};
  const CameraModel seen =
      truth->model_of(raw.source->info(), raw.source->info().width, raw.source->info().height);
  if (info.has_flow && !(seen == pinhole_of(info))) return flow_of_lens(info.name);
  const FrameIntake::Options options{pinhole_of(info), info.rate, raw.stamps, uri.latency,
                                     info.name};
  auto source = std::make_unique<LiveSource>(
      std::make_shared<LiveCamera>(std::move(raw), std::move(again), *truth, info.sensor, options),
      info);
  if (const Status started = source->start(); !started) return started.error();
  return std::unique_ptr<DepthSource>(std::move(source));
}

}}  // namespace palpate::v0
