#include "palpate/cloud/depth_source.h"

#include <algorithm>
#include <array>
#include <cstdint>

namespace palpate { inline namespace v0 {

DepthStreamInfo binned(const DepthStreamInfo& stream, int binning) {
  DepthStreamInfo small = stream;
  small.width = stream.width / binning;
  small.height = stream.height / binning;
  const auto [fx, fy, cx, cy] = stream.intrinsics;
  const double middle = 0.5 * (binning - 1);  // of the first square
  small.intrinsics = {fx / binning, fy / binning, (cx - middle) / binning, (cy - middle) / binning};
  return small;
}

void bin_depth(const DepthImageView& image, int binning, DepthFrame& small) {
  small.width = image.width / binning;
  small.height = image.height / binning;
  small.unit = image.unit;
  small.pixels.resize(static_cast<std::size_t>(small.width) *
                      static_cast<std::size_t>(small.height));
  std::array<std::uint32_t, kMaxBinning * kMaxBinning> counts{};
  const auto width = static_cast<std::size_t>(image.width),
             side = static_cast<std::size_t>(binning);
  std::uint16_t* out = small.pixels.data();
  for (int v = 0; v < small.height; ++v) {
    for (int u = 0; u < small.width; ++u) {
      const std::uint16_t* const corner = image.counts +
                                          static_cast<std::size_t>(v) * side * width +
                                          static_cast<std::size_t>(u) * side;
      auto end = counts.begin();
      for (std::size_t y = 0; y < side; ++y) {
        for (std::size_t x = 0; x < side; ++x) {
          const std::uint16_t count = corner[y * width + x];
          if (count != 0) *end++ = count;
        }
      }
      if (end == counts.begin()) {
        *out++ = 0;
        continue;
      }
      const auto median = counts.begin() + (end - counts.begin() - 1) / 2;
      std::nth_element(counts.begin(), median, end);
      const std::uint32_t middle = *median;
      if (middle == kFarCount) {
        *out++ = kFarCount;
        continue;
      }
      std::uint32_t sum = 0, num = 0;
      for (auto count = counts.begin(); count != end; ++count) {
        const std::uint32_t off = *count > middle ? *count - middle : middle - *count;
        if (32 * off > middle) continue;
        sum += *count;
        ++num;
      }
      *out++ = static_cast<std::uint16_t>((2 * sum + num) / (2 * num));
    }
  }
}

}}  // namespace palpate::v0
