// The meaning of the counts of a raw depth frame. Shared by host and device.
#pragma once

#include "palpate/core/core.h"

namespace palpate::inline v0 {

PALPATE_HOSTDEV inline bool is_measurement(int count) { return count != 0 && count != 65535; }

/// Metres; 0: no measurement.
PALPATE_HOSTDEV inline float depth_of(int count, double unit) {
  return static_cast<float>(count == 65535 ? 0.0 : count * unit);
}

/// NaN is not.
PALPATE_HOSTDEV inline bool is_usable_depth(float z, float min_depth, float max_depth) {
  return (z >= min_depth) & (z <= max_depth);
}

}  // namespace palpate::inline v0
