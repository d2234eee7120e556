#include <cmath>
#include <limits>

#include "scenes/depth_renderer.h"
#include "scenes/noise_model.h"
#include "scenes/scene.h"

namespace palpate { inline namespace v0 { namespace scenes {
namespace {

class SimulatedCamera final : public DepthSource {
 public:
  SimulatedCamera(Scene scene, const SimulatedCameraOptions& options, int num_frames)
      : renderer_(std::move(scene)),
        sensor_(options.noise, renderer_.scene().intrinsics, renderer_.scene().width,
                renderer_.scene().height, options.unit, options.seed) {
    const Scene& s = renderer_.scene();
    info_ = {s.width, s.height, s.intrinsics, options.unit, s.rate, num_frames, s.name};
    info_.is_moving = s.is_camera_moving;
  }

  const DepthStreamInfo& info() const override { return info_; }

  Result<bool> next(DepthFrame& frame) override {
    if (next_frame_ >= *info_.num_frames) return false;
    frame.width = info_.width;
    frame.height = info_.height;
    frame.unit = info_.unit;
    frame.timestamp = next_frame_ / info_.rate;
    frame.X_WC = renderer_.scene().X_WC ? renderer_.scene().X_WC(frame.timestamp) : Pose{};
    const std::span<const float> depth = renderer_.render(frame.timestamp);
    frame.pixels.resize(depth.size());
    sensor_.measure(depth, static_cast<std::uint64_t>(next_frame_), frame.pixels);
    ++next_frame_;
    return true;
  }

 private:
  DepthRenderer renderer_;
  DepthSensor sensor_;
  DepthStreamInfo info_;
  int next_frame_ = 0;
};

struct Range {
  const char* name;
  double value, low, high;
};

/// The first number out of its range, as an error.
Status check(const std::vector<Range>& ranges) {
  for (const Range& r : ranges) {
    if (r.value >= r.low && r.value <= r.high) continue;
    return Error{Errc::invalid_argument, std::string("simulated camera: ") + r.name + " is " +
                                             std::to_string(r.value) + "; give a number from " +
                                             std::to_string(r.low) + " to " +
                                             std::to_string(r.high)};
  }
  return Done{};
}

}  // namespace

Result<std::unique_ptr<DepthSource>> open_simulated_camera(Scene scene,
                                                           const SimulatedCameraOptions& options) {
  const double duration = options.duration.value_or(scene.duration);
  const NoiseModel& noise = options.noise;
  const Status status = check({{"the image width", double(scene.width), 8, kMaxImageWidth},
                               {"the image height", double(scene.height), 8, kMaxImageHeight},
                               {"the focal length", scene.intrinsics.fx, 1, 1e6},
                               {"the focal length", scene.intrinsics.fy, 1, 1e6},
                               {"the image center", scene.intrinsics.cx, -1e6, 1e6},
                               {"the image center", scene.intrinsics.cy, -1e6, 1e6},
                               {"the frame rate", scene.rate, 0.001, 10000},
                               {"the duration", duration, 1e-6, 1e5},
                               {"the depth unit", options.unit, 1e-6, 1},
                               {"the axial noise", noise.axial_base, 0, 1},
                               {"the growth of the axial noise", noise.axial_growth, 0, 1},
                               {"the number of disparity steps", noise.disparity_steps, 0, 1e6},
                               {"the baseline", noise.baseline, 0, 10},
                               {"the share of missing pixels", noise.missing, 0, 1},
                               {"the lateral noise", noise.lateral, 0, 100}});
  if (!status) return status.error();
  const int num_frames = static_cast<int>(std::ceil(duration * scene.rate - 1e-6));
  return std::unique_ptr<DepthSource>(
      std::make_unique<SimulatedCamera>(std::move(scene), options, std::max(1, num_frames)));
}

}}}  // namespace palpate::v0::scenes
