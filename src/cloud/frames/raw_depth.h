// The meaning of the counts of a raw depth frame. Shared by host and device.
#pragma once

#include <limits>

#include "palpate/cloud/depth_source.h"
#include "palpate/core/core.h"

namespace palpate { inline namespace v0 {

inline constexpr float kFar = std::numeric_limits<float>::infinity();  ///< m; see kFarCount
inline constexpr float kFarthest = std::numeric_limits<float>::max();  ///< m, the largest but kFar

/// True if the count is a distance.
PALPATE_HOSTDEV inline bool is_measurement(int count) { return count != 0 && count != kFarCount; }

/// Meters; 0: no measurement.
PALPATE_HOSTDEV inline float depth_of(int count, double unit) {
  return count == kFarCount ? kFar : static_cast<float>(count * unit);
}

/// False for NaN.
PALPATE_HOSTDEV inline bool is_usable_depth(float z, float min_depth, float max_depth) {
  return (z >= min_depth) & (z <= max_depth);
}

}}  // namespace palpate::v0
