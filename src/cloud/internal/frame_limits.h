// Limits of the numbers of a depth frame.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <vector>

#include "palpate/cloud/depth_source.h"

namespace palpate { inline namespace v0 {

/// Largest time stamp, s: three hundred years. A larger one has another unit (milliseconds or
/// nanoseconds since 1970), or is too coarse to tell frames apart.
inline constexpr double kLargestTimeStamp = 1e10;

/// False for NaN, too.
inline bool is_in_seconds(double time_stamp) { return std::abs(time_stamp) <= kLargestTimeStamp; }

/// Longest usual step of times in seconds, s: a longer one has another unit.
inline constexpr double kLongestUsualStep = 1e4;

/// Returns the median of the steps from each entry to the next one; 0 for a single one.
template <class Timed>
double usual_step(const std::vector<Timed>& entries) {
  std::vector<double> steps;
  for (std::size_t i = 1; i < entries.size(); ++i) {
    steps.push_back(entries[i].time - entries[i - 1].time);
  }
  if (steps.empty()) return 0;
  const auto middle = steps.begin() + std::ssize(steps) / 2;
  std::ranges::nth_element(steps, middle);
  return *middle;
}

/// m per count.
inline constexpr double kLargestUnit = 1;

/// m per count of depth in meters: up to 16 m in steps of 0.25 mm.
inline constexpr double kFloatUnit = 0.00025;

inline bool is_depth_unit(double unit) { return unit > 0 && unit <= kLargestUnit; }

/// Converts meters to counts, kFarCount for depth beyond the range, up to +inf (REP 117: nothing is
/// within range). NaN, depth that is too near and -inf are no measurement, 0.
inline std::uint16_t count_of(double meters, double unit) {
  const double count = std::floor(meters / unit + 0.5);
  if (!(count >= 1)) return 0;  // nor is NaN a measurement
  return count < kFarCount ? static_cast<std::uint16_t>(count) : kFarCount;
}

/// Removes kFarCount unless the sensor can measure so far.
inline void drop_far_codes(DepthFrame& frame, SensorKind sensor) {
  if (!can_be_far(sensor)) std::ranges::replace(frame.pixels, kFarCount, std::uint16_t{0});
}

}}  // namespace palpate::v0
