// The newest frame of each camera of a run, kept once for all that look at it (UnitWatch,
// NearestWatch).
#pragma once

#include <span>
#include <utility>
#include <vector>

#include "palpate/cloud/depth_source.h"
#include "palpate/run/records.h"

namespace palpate { inline namespace v0 {

/// A camera and its newest frame; without pixels before the first one.
struct NewestFrame {
  DepthStreamInfo stream;
  DepthFrame frame;
  Pose X_WC = {};
  double unit = 0.001;  ///< m per count

  /// Counts of the pixel in column u and row v; 0 and kFarCount: no distance.
  std::uint16_t count(int u, int v) const {
    return frame.pixels[static_cast<std::size_t>(v) * static_cast<std::size_t>(frame.width) +
                        static_cast<std::size_t>(u)];
  }
};

/// Owns the frames; they are looked at ten times a second of the run.
class NewestFrames {
 public:
  explicit NewestFrames(std::vector<DepthStreamInfo> streams) {
    for (DepthStreamInfo& stream : streams) cameras_.push_back({std::move(stream), {}});
  }

  /// Keeps a frame instead of that before. O(pixels).
  void take(const FrameRecord& record, const DepthFrame& frame) {
    NewestFrame& camera = cameras_[record.camera];
    camera.frame = frame;
    camera.X_WC = record.X_WC;
    camera.unit = record.unit;
  }
  /// Returns whether it is time for a look.
  bool is_due(double time) {
    if (time < next_look_) return false;
    next_look_ = time + kPeriod;
    return true;
  }
  std::span<const NewestFrame> all() const { return cameras_; }

 private:
  static constexpr double kPeriod = 0.1;  // s

  std::vector<NewestFrame> cameras_;
  double next_look_ = 0;  // s
};

}}  // namespace palpate::v0
