// A safety filter with a clock, as its tests drive it.
#pragma once

#include <gtest/gtest.h>

#include <limits>

#include "palpate/haptics/safety.h"

namespace palpate::test::safety_rig {

inline constexpr double kTick = 1e-3;
inline constexpr double kNan = std::numeric_limits<double>::quiet_NaN();
inline constexpr double kInf = std::numeric_limits<double>::infinity();
inline const DeviceLimits kLimits{.max_force = 10, .max_torque = 0.2, .max_damping = 20};
inline const Wrench kNothing{};

inline SafetyFilter make_filter(const SafetyOptions& options = {},
                                const DeviceLimits& limits = kLimits) {
  auto filter = SafetyFilter::create(limits, options);
  EXPECT_TRUE(filter.has_value()) << filter.error().message;
  return *filter;
}

/// A filter and a clock.
struct Rig {
  explicit Rig(const SafetyOptions& options = {}, const DeviceLimits& limits = kLimits)
      : filter(make_filter(options, limits)) {
    input.time = 100;
    input.state.is_valid = true;
  }
  Wrench tick(const Wrench& desired, double dt = kTick) {
    input.time += dt;
    return filter.filter(desired, input);
  }
  /// Engages and goes up to this wrench.
  Wrench hold(const Wrench& desired) {
    for (int i = 0; i < 20; ++i) tick(kNothing);
    Wrench out;
    for (int i = 0; i < 1000; ++i) out = tick(desired);
    return out;
  }
  Fault fault() const { return filter.status().fault; }

  SafetyFilter filter;
  SafetyInput input;
};

inline const Wrench kPush{{3, -2, 1}, {0.05, 0, -0.1}};

inline double distance(const Wrench& a, const Wrench& b) {
  return norm(a.force - b.force) + norm(a.torque - b.torque);
}

/// Ticks without contact until the force is back; -1: it did not come.
inline int ticks_until_engaged(Rig& rig, int most) {
  for (int i = 0; i < most; ++i) {
    if (rig.filter.status().is_engaged()) return i;
    rig.tick(kNothing);
  }
  return -1;
}

inline void break_once(Rig& rig) {
  rig.input.backend_failed = true;
  rig.tick(kPush);
  rig.input.backend_failed = false;
}

}  // namespace palpate::test::safety_rig
