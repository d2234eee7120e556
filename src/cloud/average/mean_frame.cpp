#include "src/cloud/internal/mean_frame.h"

#include <cmath>
#include <cstdint>
#include <vector>

#include "src/cloud/frames/raw_depth.h"

namespace palpate { inline namespace v0 {

Result<DepthFrame> mean_frame(DepthSource& source, int num_frames) {
  const DepthStreamInfo& stream = source.info();
  std::vector<double> sums;
  std::vector<int> nums;
  DepthFrame frame;
  int num = 0;
  for (; num < num_frames; ++num) {
    const auto got = source.next(frame);
    if (!got) return got.error();
    if (!*got) break;
    sums.resize(frame.pixels.size());
    nums.resize(frame.pixels.size());
    for (std::size_t i = 0; i < sums.size() && i < frame.pixels.size(); ++i) {
      if (!is_measurement(frame.pixels[i])) continue;
      sums[i] += frame.pixels[i] * frame.unit;
      ++nums[i];
    }
  }
  if (num == 0) return Error{Errc::bad_input, stream.name + " has no frames"};
  frame.unit = 1.5e-4;  // m: up to 9.8 m
  for (std::size_t i = 0; i < sums.size(); ++i) {
    const double counts = nums[i] > 0 ? sums[i] / nums[i] / frame.unit : 0;
    frame.pixels[i] =
        2 * nums[i] >= num && counts < 65534 ? static_cast<std::uint16_t>(std::lround(counts)) : 0;
  }
  return frame;
}

}}  // namespace palpate::v0
