// Monotonic time as wall time, for the headers of ROS messages. The offset is measured at every
// call: the wall clock may be set while the run goes on.
#pragma once

#include <algorithm>
#include <chrono>
#include <cstdint>
#include <limits>

#include "src/core/internal/monotonic_clock.h"

namespace palpate::apps {

/// Converts monotonic time to wall time, ns; reads both clocks again if interrupted in between.
inline std::uint64_t wall_time(double time) {
  constexpr double kShort = 20e-6;  // s
  double shortest = std::numeric_limits<double>::infinity(), from_1970 = 0;
  for (int i = 0; i < 5 && shortest > kShort; ++i) {
    const double before = monotonic_now();
    const double wall =
        std::chrono::duration<double>(std::chrono::system_clock::now().time_since_epoch()).count();
    const double took = monotonic_now() - before;
    if (took < shortest) from_1970 = wall - (before + took / 2);
    shortest = std::min(shortest, took);
  }
  return static_cast<std::uint64_t>(1e9 * (from_1970 + time));
}

}  // namespace palpate::apps
