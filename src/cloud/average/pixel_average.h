// The average of one pixel's depth over time. Shared by host and device.
#pragma once

#include <cmath>
#include <cstddef>
#include <cstdint>
#include <limits>

#include "palpate/cloud/depth_source.h"
#include "palpate/core/core.h"
#include "src/cloud/frames/raw_depth.h"

namespace palpate { inline namespace v0 {

inline constexpr float kNoAverage = std::numeric_limits<float>::quiet_NaN();

/// State of a pixel's average. Sums of counts are integers, so that nothing drifts.
struct PixelAverage {
  std::uint32_t sum = 0;         ///< moving: of the ring
  float mean = 0;                ///< exponential, in counts
  float unit = 0;                ///< m per count: another unit starts a new average
  std::uint8_t num = 0;          ///< measurements in the average; exponential: 0 or 1
  std::uint8_t next = 0;         ///< moving: next index in the ring
  std::uint8_t num_missing = 0;  ///< frames since the last measurement
};

/// Moving: the last measurements of a pixel, options.frames of them, `stride` apart.
struct PixelRing {
  std::uint16_t* first = nullptr;
  std::ptrdiff_t stride = 0;

  PALPATE_HOSTDEV std::uint16_t& operator[](int i) const { return first[i * stride]; }
};

/// Returns the mean, in counts.
PALPATE_HOSTDEV inline double mean_of(const PixelAverage& average,
                                      const DepthAverageOptions& options) {
  return options.kind == DepthAverage::moving
             ? static_cast<double>(average.sum) / static_cast<double>(average.num)
             : static_cast<double>(average.mean);
}

PALPATE_HOSTDEV inline void add_measurement(PixelAverage& average, const PixelRing& ring,
                                            std::uint16_t count,
                                            const DepthAverageOptions& options) {
  if (average.num > 0) {
    const double mean = mean_of(average, options);
    if (std::fabs(count - mean) > options.max_jump * mean) average = {};
  }
  average.num_missing = 0;
  if (options.kind == DepthAverage::exponential) {
    const float weight = average.num > 0 ? static_cast<float>(options.weight) : 1.0f;
    average.mean += weight * (static_cast<float>(count) - average.mean);
    average.num = 1;
    return;
  }
  if (average.num == options.frames) {
    average.sum -= ring[average.next];
  } else {
    ++average.num;
  }
  average.sum += count;
  ring[average.next] = count;
  average.next = static_cast<std::uint8_t>((average.next + 1) % options.frames);
}

/// Takes one more count, which may be no measurement. Returns the average in meters, NaN if there
/// is none; kFar at once for a pixel that is too far, which has no mean.
PALPATE_HOSTDEV inline float update_average(PixelAverage& average, const PixelRing& ring,
                                            std::uint16_t count, double unit,
                                            const DepthAverageOptions& options) {
  const auto narrow_unit = static_cast<float>(unit);
  if (average.unit != narrow_unit) average = {};
  if (is_measurement(count)) {
    add_measurement(average, ring, count, options);
  } else if (average.num > 0 && ++average.num_missing > options.keep_frames) {
    average = {};
  }
  average.unit = narrow_unit;
  if (count == kFarCount) return kFar;
  return average.num > 0 ? static_cast<float>(mean_of(average, options) * unit) : kNoAverage;
}

/// Returns the depth of a count without averaging.
PALPATE_HOSTDEV inline float newest_depth(std::uint16_t count, double unit) {
  return count == 0 ? kNoAverage : depth_of(count, unit);
}

/// An error says what is out of range.
Status check_average_settings(int width, int height, const DepthAverageOptions& options);

}}  // namespace palpate::v0
