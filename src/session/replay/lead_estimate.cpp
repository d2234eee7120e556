#include "src/session/replay/lead_estimate.h"

#include <algorithm>
#include <utility>

namespace palpate { inline namespace v0 {

void LeadEstimate::begin(std::uint32_t revision, const RunSettings& settings) {
  beginnings_.push_back({revision, settings.time.average, settings.binning});
}

bool LeadEstimate::is_known_before(std::int64_t camera_frame, std::uint32_t revision) const {
  if (begins_with(revision)) {
    const auto begins =
        std::find_if(beginnings_.rbegin(), beginnings_.rend(),
                     [&](const Beginning& beginning) { return beginning.revision <= revision; });
    return begins->average.kind != DepthAverage::kalman || last_ + 1 == camera_frame;
  }
  return averager_ == nullptr || (is_whole_ && last_ + 1 == camera_frame);
}

void LeadEstimate::take(const RecordedDepth& frame) {
  std::optional<Beginning> begins;
  while (begins_with(frame.record.revision)) {
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

}}  // namespace palpate::v0
