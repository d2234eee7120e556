// Limits of the numbers of a depth frame.
#pragma once

#include <cmath>

namespace palpate::inline v0 {

/// s: three hundred years. A time stamp beyond it is of another unit (what counts milliseconds or
/// nanoseconds since 1970 is), or too coarse to tell frames apart.
inline constexpr double kLargestTimeStamp = 1e10;

/// False too for one that is no number.
inline bool is_in_seconds(double time_stamp) { return std::abs(time_stamp) <= kLargestTimeStamp; }

/// m per count.
inline constexpr double kLargestUnit = 1;

inline bool is_depth_unit(double unit) { return unit > 0 && unit <= kLargestUnit; }

}  // namespace palpate::inline v0
