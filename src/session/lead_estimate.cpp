#include "src/session/lead_estimate.h"

#include <utility>

namespace palpate {

void LeadEstimate::begin(std::uint32_t revision, const RunSettings& settings) {
  beginnings_.push_back({revision, settings.time.average, settings.binning});
}

void LeadEstimate::take(const RecordedDepth& frame) {
  std::optional<Beginning> begins;
  while (!beginnings_.empty() && beginnings_.front().revision <= frame.record.revision) {
    begins = beginnings_.front();
    beginnings_.pop_front();
  }
  if (begins) {
    averager_.reset();
    revision_ = begins->revision;
    binning_ = begins->binning;
    is_whole_ = true;
    if (begins->average.kind == DepthAverage::kalman) {
      const DepthStreamInfo seen = binned(stream_, binning_);
      auto made = DepthAverager::create(seen.width, seen.height, begins->average);
      is_whole_ = made.has_value();
      if (made) averager_ = std::make_unique<DepthAverager>(*std::move(made));
      if (pool_ == nullptr) pool_ = std::make_unique<ThreadPool>(1);
    }
  }
  const auto number = static_cast<std::int64_t>(frame.record.camera_frame);
  if (number != std::exchange(last_, number) + 1) is_whole_ = false;
  if (averager_ == nullptr) return;
  if (binning_ > 1) bin_depth(frame.frame, binning_, small_);
  averager_->update(binning_ > 1 ? small_ : frame.frame, *pool_);
}

}  // namespace palpate
