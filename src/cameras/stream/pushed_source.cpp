#include <mutex>
#include <string>
#include <utility>

#include "palpate/cameras/cameras.h"
#include "src/cameras/stream/frame_intake.h"
#include "src/cameras/stream/rectifier.h"
#include "src/cloud/internal/cloud_camera.h"
#include "src/cloud/internal/frame_limits.h"
#include "src/cloud/internal/lens_table.h"
#include "src/core/internal/monotonic_clock.h"

namespace palpate { inline namespace v0 {
namespace {

class Pushed final : public PushedSource {
 public:
  Pushed(const DepthStreamInfo& info, const Options& options)
      : info_(info),
        truth_{{}, {}, {}, {info.width, info.height}},
        intake_({{info.width, info.height, info.intrinsics, {}},
                 info.rate,
                 options.has_time_stamps ? StampClock::cameras : StampClock::none,
                 options.latency,
                 info.name.empty() ? "the pushed camera" : info.name}),
        raw_info_(info),
        points_camera_({info.width, info.height, info.intrinsics, {}}, info.unit) {
    truth_.intrinsics = info.intrinsics;
    info_.is_live = true;
    info_.num_frames = {};
    info_.distortion = {};
  }

  void push(DepthFrame& frame) override {
    const double now = monotonic_now();
    if (frame.width < 1 || frame.height < 1 || frame.width > kMaxImageWidth ||
        frame.height > kMaxImageHeight ||
        frame.pixels.size() !=
            static_cast<std::size_t>(frame.width) * static_cast<std::size_t>(frame.height)) {
      intake_.add_note("got a frame whose number of pixels does not match its size; it is dropped");
      return;
    }
    drop_far_codes(frame, info_.sensor);
    const Pose X_WC = frame.X_WC;
    intake_.give(frame, truth_.model_of(raw_info_, frame.width, frame.height), now);
    frame.X_WC = X_WC;  // of the memory that came back: what the caller has set stays
    frame.flow.clear();
  }
  void push_points(const PointsView& points, const Pose& X_WC, double timestamp) override {
    const double now = monotonic_now();
    const std::size_t num = points.points.size();
    if (points.width < 1 || points.height < 1 || num > kMaxCloudPoints ||
        num != static_cast<std::size_t>(points.width) * static_cast<std::size_t>(points.height) ||
        (!points.normals.empty() && points.normals.size() != num)) {
      intake_.add_note(
          "got points whose number does not match their size or their normals, or is above " +
          std::to_string(kMaxCloudPoints) + "; they are dropped");
      return;
    }
    const std::lock_guard lock(points_mutex_);
    const CloudShares shares = points_camera_.take(points, points_frame_);
    if (!shares.is_image && !std::exchange(is_noted_, true)) intake_.add_note(shares.text());
    drop_far_codes(points_frame_, info_.sensor);
    points_frame_.X_WC = X_WC;
    points_frame_.stamp = 0;
    points_frame_.timestamp = timestamp;
    intake_.give(points_frame_, points_camera_.model(), now);
  }
  void end() override { intake_.end(false); }

  const DepthStreamInfo& info() const override { return info_; }
  Result<bool> next(DepthFrame& frame) override { return intake_.next(frame); }
  void cancel() noexcept override { intake_.cancel(); }
  std::vector<std::string> take_notes() override { return intake_.take_notes(); }

 private:
  DepthStreamInfo info_;
  CameraTruth truth_;
  FrameIntake intake_;
  const DepthStreamInfo raw_info_;  // with its distortion
  std::mutex points_mutex_;         // guards the members below
  CloudCamera points_camera_;
  DepthFrame points_frame_;
  bool is_noted_ = false;
};

}  // namespace

Result<std::unique_ptr<PushedSource>> PushedSource::create(const DepthStreamInfo& info,
                                                           const Options& options) {
  if (info.width < 8 || info.height < 8 || info.width > kMaxImageWidth ||
      info.height > kMaxImageHeight || !(info.intrinsics.fx > 0) || !(info.intrinsics.fy > 0)) {
    return Error{Errc::invalid_argument,
                 "pushed frames need a size from 8x8 to 4096x4096 and focal lengths above 0"};
  }
  if (!is_depth_unit(info.unit)) {
    return Error{Errc::invalid_argument,
                 "pushed frames need a unit above 0 and of at most 1 m per count"};
  }
  if (!(options.latency >= 0 && options.latency <= 1)) {
    return Error{Errc::invalid_argument, "the latency of pushed frames must be from 0 to 1 s"};
  }
  if (const Status status = check_distortion(info.distortion); !status) return status.error();
  if (info.has_flow && !(info.distortion == Distortion{})) return flow_of_lens(info.name);
  return std::unique_ptr<PushedSource>(std::make_unique<Pushed>(info, options));
}

Result<std::unique_ptr<PushedSource>> PushedSource::create(const DepthStreamInfo& info) {
  return create(info, {});
}

}}  // namespace palpate::v0
