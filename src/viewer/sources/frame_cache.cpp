#include "src/viewer/sources/frame_cache.h"

#include <algorithm>
#include <utility>

namespace palpate { inline namespace v0 {
namespace {

constexpr std::size_t kMaxBytes = std::size_t(64) << 20, kMinFrames = 3;

}  // namespace

FrameCache::FrameCache(RecordedRun& run) : run_(run) {
  std::size_t num_pixels = 0;
  for (const DepthStreamInfo& stream : run.streams()) {
    num_pixels = std::max(num_pixels, static_cast<std::size_t>(stream.width) *
                                          static_cast<std::size_t>(stream.height));
  }
  max_frames_ = std::max(
      kMinFrames, kMaxBytes / (sizeof(std::uint16_t) * std::max<std::size_t>(num_pixels, 1)));
}

Result<std::shared_ptr<const RecordedFrame>> FrameCache::get(std::size_t index) {
  const auto known = std::find_if(frames_.begin(), frames_.end(),
                                  [&](const auto& entry) { return entry.first == index; });
  if (known != frames_.end()) {
    frames_.splice(frames_.begin(), frames_, known);
    return frames_.front().second;
  }
  if (const auto lost = lost_.find(index); lost != lost_.end()) return lost->second;
  auto frame = run_.read_frame(index);
  if (!frame) {
    if (frame.error().code == Errc::bad_input) lost_.emplace(index, frame.error());
    return frame.error();
  }
  frames_.emplace_front(index, std::make_shared<const RecordedFrame>(*std::move(frame)));
  if (frames_.size() > max_frames_) frames_.pop_back();
  return frames_.front().second;
}

}}  // namespace palpate::v0
