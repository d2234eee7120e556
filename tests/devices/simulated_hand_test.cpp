#include "src/devices/software/simulated_hand.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

namespace palpate {
namespace {

TEST(ImpedanceStep, ManySmallStepsMakeALargeOne) {
  for (const auto& [damping, stiffness] :
       {std::pair{0.0, 0.0}, {2.0, 0.0}, {0.0, 50.0}, {1e3, 5e3}}) {
    const ImpedanceStep large(0.1, damping, stiffness, 0.08), small(0.1, damping, stiffness, 0.005);
    const Vec3d push{1, -2, 3};
    Vec3d p{0.1, 0.2, -0.3}, v{-1, 0.5, 0.2}, p_small = p, v_small = v;
    large(p, v, push);
    for (int i = 0; i < 16; ++i) small(p_small, v_small, push);
    EXPECT_LT(norm(p - p_small), 1e-11);
    EXPECT_LT(norm(v - v_small), 1e-11);
  }
}

TEST(ImpedanceStep, FallsAsGalileoSaid) {
  const ImpedanceStep fall(2, 0, 0, 0.5);
  Vec3d p, v{1, 0, 0};
  fall(p, v, {0, 0, -9.81});
  EXPECT_NEAR(p.x, 0.5, 1e-15);
  EXPECT_NEAR(p.z, -0.5 * 9.81 * 0.25, 1e-14);
  EXPECT_NEAR(v.z, -9.81 * 0.5, 1e-14);
}

TEST(ExploringHand, SetsOutAtTheBackAndReachesForwardInsideItsWorkspace) {
  const HandTarget target = exploring_hand(0.1);
  EXPECT_NEAR(target(0).translation.z, -0.06, 1e-12);
  EXPECT_EQ(target(0).rotation, Quaternion{});
  EXPECT_NEAR(target(4).translation.z, 0.06, 1e-12);
  double fastest = 0;
  for (double t = 0; t < 30; t += 0.001) {
    const Vec3d p = target(t).translation;
    EXPECT_LT(norm(p), 0.1);
    fastest = std::max(fastest, norm(target(t + 1e-3).translation - p) / 1e-3);
  }
  EXPECT_LT(fastest, 0.15);  // m/s, a hand that feels its way
}

}  // namespace
}  // namespace palpate
