// The expected time of the next frame, for every frame of a camera.
#pragma once

#include <memory>
#include <optional>
#include <utility>

#include "palpate/field/sensor.h"

namespace palpate { inline namespace v0 {

/// Expected periods, from a timeline of tiny frames, which has the timing of one of large ones.
class FramePeriods {
 public:
  FramePeriods(const DepthStreamInfo& stream, const TimeOptions& time) {
    DepthStreamInfo tiny = stream;
    tiny.width = tiny.height = frame_.width = frame_.height = kSide;
    frame_.pixels.resize(kSide * kSide);
    TimeOptions options;
    options.mode = TimeMode::latest;
    options.first_period = time.first_period;
    if (auto timeline = SurfaceTimeline::create(tiny, {.field = std::nullopt, .time = options})) {
      timeline_ = *std::move(timeline);
    }
  }

  /// Adds a frame at `clock`, s; returns the expected time to the next one, s; 0: unknown.
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

}}  // namespace palpate::v0
