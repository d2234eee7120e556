// A device and the box that it holds, for tests of couplings.
#pragma once

#include <limits>

#include "palpate/haptics/coupling.h"
#include "tests/test_util/random.h"

namespace palpate::test::coupled_box {

inline constexpr double kTick = 1e-3;
inline const DeviceLimits kLimits{.max_force = 10,
                                  .max_torque = 0.3,
                                  .max_stiffness = 2000,
                                  .max_angular_stiffness = 1,
                                  .max_damping = 30,
                                  .workspace_radius = 0.1,
                                  .damping = 1,
                                  .angular_damping = 1e-3};

/// Up to `usual` in size, and now and then a number that no device should report.
inline double strange_number(test::Random& random, double usual) {
  constexpr double kInf = std::numeric_limits<double>::infinity();
  constexpr double kBad[] = {
      std::numeric_limits<double>::quiet_NaN(), kInf, 1e308, -1e308, 0, -1, 1e-308};
  return random.uniform() < 0.02 ? kBad[random.bits() % 7] : usual * random.uniform(-1, 1);
}

/// A box of 2 x 4 x 6 cm.
inline MassProperties box_tool() {
  const double a = 0.02, b = 0.04, c = 0.06, v = a * b * c;
  MassProperties tool{v, {0.05, 0, 0.01}, {}};
  tool.inertia.m[0][0] = v * (b * b + c * c) / 12;
  tool.inertia.m[1][1] = v * (a * a + c * c) / 12;
  tool.inertia.m[2][2] = v * (a * a + b * b) / 12;
  return tool;
}

}  // namespace palpate::test::coupled_box
