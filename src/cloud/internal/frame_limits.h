// Limits of the numbers of a depth frame.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>

#include "palpate/cloud/depth_source.h"

namespace palpate::inline v0 {

/// s: three hundred years. A time stamp beyond it is of another unit (what counts milliseconds or
/// nanoseconds since 1970 is), or too coarse to tell frames apart.
inline constexpr double kLargestTimeStamp = 1e10;

/// False too for one that is no number.
inline bool is_in_seconds(double time_stamp) { return std::abs(time_stamp) <= kLargestTimeStamp; }

/// m per count.
inline constexpr double kLargestUnit = 1;

inline bool is_depth_unit(double unit) { return unit > 0 && unit <= kLargestUnit; }

/// Leaves kFarCount only to a sensor that can measure so far.
inline void drop_far_codes(DepthFrame& frame, SensorKind sensor) {
  if (!can_be_far(sensor)) std::ranges::replace(frame.pixels, kFarCount, std::uint16_t{0});
}

}  // namespace palpate::inline v0
