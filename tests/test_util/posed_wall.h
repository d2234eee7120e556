// A wall as cameras see it that stand anywhere or move.
#pragma once

#include <cmath>
#include <functional>
#include <string>
#include <utility>

#include "palpate/cloud/depth_source.h"

namespace palpate::test {

/// All of z >= depth in W, exact to 0.05 mm.
class PosedWall : public DepthSource {
 public:
  using Motion = std::function<Pose(double time)>;

  /// Endless unless `num_frames` says otherwise.
  PosedWall(Motion X_WC, double rate = 30, double depth = 0.5, int num_frames = -1)
      : X_WC_(std::move(X_WC)), depth_(depth) {
    info_.width = 96;
    info_.height = 72;
    info_.intrinsics = {90, 90, 47.5, 35.5};
    info_.unit = 0.0001;
    info_.rate = rate;
    info_.name = "a wall";
    info_.is_moving = !(X_WC_(0) == X_WC_(0.1));
    if (num_frames >= 0) info_.num_frames = num_frames;
  }
  /// A camera that stands still.
  explicit PosedWall(const Pose& X_WC, double rate = 30)
      : PosedWall([X_WC](double) { return X_WC; }, rate) {}

  const DepthStreamInfo& info() const override { return info_; }

  Result<bool> next(DepthFrame& frame) override {
    if (info_.num_frames && next_ == *info_.num_frames) return false;
    frame.width = info_.width;
    frame.height = info_.height;
    frame.unit = info_.unit;
    frame.timestamp = next_++ / info_.rate;
    frame.X_WC = X_WC_(frame.timestamp);
    const auto& [fx, fy, cx, cy] = info_.intrinsics;
    frame.pixels.clear();
    for (int v = 0; v < frame.height; ++v) {
      for (int u = 0; u < frame.width; ++u) {
        const Vec3d d_W = rotate(frame.X_WC.rotation, {(u - cx) / fx, (v - cy) / fy, 1});
        const double z = (depth_ - frame.X_WC.translation.z) / d_W.z;
        const bool is_seen = d_W.z > 0 && z > 0.1 && z < 6;
        frame.pixels.push_back(is_seen ? static_cast<std::uint16_t>(std::lround(z / info_.unit))
                                       : std::uint16_t{0});
      }
    }
    return true;
  }

 private:
  Motion X_WC_;
  double depth_;
  DepthStreamInfo info_;
  int next_ = 0;
};

/// Half a meter from the origin of the wall at z = 0.5, turned about it by an angle.
inline Pose beside_wall(double angle, double wall = 0.5) {
  return {{wall * std::sin(angle), 0, wall * (1 - std::cos(angle))}, axis_angle({0, 1, 0}, -angle)};
}

}  // namespace palpate::test
