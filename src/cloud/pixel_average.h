// The average of one pixel's depth over time. Shared by host and device.
#pragma once

#include <cmath>
#include <cstddef>
#include <cstdint>
#include <limits>

#include "palpate/cloud/depth_source.h"
#include "palpate/core/core.h"
#include "src/cloud/raw_depth.h"

namespace palpate::inline v0 {

constexpr float kNoAverage = std::numeric_limits<float>::quiet_NaN();

/// What a pixel remembers. Sums of counts are whole numbers, so that nothing drifts.
struct PixelMemory {
  std::uint32_t sum = 0;         ///< moving: of the ring
  float mean = 0;                ///< exponential, in counts
  std::uint8_t num = 0;          ///< measurements in the average; exponential: 0 or 1
  std::uint8_t next = 0;         ///< moving: where the ring is written next
  std::uint8_t num_missing = 0;  ///< frames since the last measurement
};

/// Moving: the last measurements of a pixel, options.frames of them, `stride` apart.
struct PixelRing {
  std::uint16_t* first = nullptr;
  std::ptrdiff_t stride = 0;

  PALPATE_HOSTDEV std::uint16_t& operator[](int i) const { return first[i * stride]; }
};

/// Counts.
PALPATE_HOSTDEV inline double average_of(const PixelMemory& memory,
                                         const DepthAverageOptions& options) {
  return options.kind == DepthAverage::moving
             ? static_cast<double>(memory.sum) / static_cast<double>(memory.num)
             : static_cast<double>(memory.mean);
}

PALPATE_HOSTDEV inline void add_measurement(PixelMemory& memory, const PixelRing& ring,
                                            std::uint16_t count,
                                            const DepthAverageOptions& options) {
  if (memory.num > 0) {
    const double mean = average_of(memory, options);
    if (std::fabs(count - mean) > options.max_jump * mean) memory = {};
  }
  memory.num_missing = 0;
  if (options.kind == DepthAverage::exponential) {
    const float weight = memory.num > 0 ? static_cast<float>(options.weight) : 1.0f;
    memory.mean += weight * (static_cast<float>(count) - memory.mean);
    memory.num = 1;
    return;
  }
  if (memory.num == options.frames) {
    memory.sum -= ring[memory.next];
  } else {
    ++memory.num;
  }
  memory.sum += count;
  ring[memory.next] = count;
  memory.next = static_cast<std::uint8_t>((memory.next + 1) % options.frames);
}

/// Takes one more count, which may be no measurement. Returns metres, NaN where there is none.
PALPATE_HOSTDEV inline float update_average(PixelMemory& memory, const PixelRing& ring,
                                            std::uint16_t count, double unit,
                                            const DepthAverageOptions& options) {
  if (is_measurement(count)) {
    add_measurement(memory, ring, count, options);
  } else if (memory.num > 0 && ++memory.num_missing > options.keep_frames) {
    memory = {};
  }
  return memory.num > 0 ? static_cast<float>(average_of(memory, options) * unit) : kNoAverage;
}

/// The same without an average.
PALPATE_HOSTDEV inline float newest_depth(std::uint16_t count, double unit) {
  return is_measurement(count) ? static_cast<float>(count * unit) : kNoAverage;
}

}  // namespace palpate::inline v0
