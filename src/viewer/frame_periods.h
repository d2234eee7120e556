// The expected time of the next frame, for every frame of a camera.
#pragma once

#include <memory>
#include <optional>
#include <utility>

#include "palpate/field/sensor.h"

namespace palpate::inline v0 {

/// A timeline of tiny frames has the same sense of time as one of large ones.
class FramePeriods {
 public:
  FramePeriods(const DepthStreamInfo& stream, const TimeOptions& time) {
    DepthStreamInfo tiny = stream;
    tiny.width = tiny.height = frame_.width = frame_.height = kSide;
    frame_.pixels.resize(kSide * kSide);
    TimeOptions options;
    options.mode = TimeMode::latest;
    options.first_period = time.first_period;
    if (auto timeline = SurfaceTimeline::create(tiny, {}, std::nullopt, options)) {
      timeline_ = *std::move(timeline);
    }
  }

  /// s from the next frame to the one after it; 0 if that is not known.
  double add(double clock) {
    if (!timeline_) return 0;
    timeline_->push(frame_, clock, *pool_);
    return timeline_->period();
  }

 private:
  static constexpr int kSide = 8;
  DepthFrame frame_;
  std::unique_ptr<ThreadPool> pool_ = std::make_unique<ThreadPool>(1);
  std::optional<SurfaceTimeline> timeline_;
};

}  // namespace palpate::inline v0
