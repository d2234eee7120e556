// When the next frame was expected, for every frame of a recording.
#pragma once

#include <vector>

#include "palpate/field/surface_timeline.h"

namespace palpate {

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

  /// The next frame.
  void add(double clock) {
    if (timeline_) timeline_->push(frame_, clock, pool_);
    periods_.push_back(timeline_ ? timeline_->period() : 0);
  }
  double after(std::size_t index) const { return periods_[index]; }

 private:
  static constexpr int kSide = 8;
  DepthFrame frame_;
  ThreadPool pool_{1};
  std::optional<SurfaceTimeline> timeline_;
  std::vector<double> periods_;
};

}  // namespace palpate
