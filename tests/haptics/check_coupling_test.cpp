// Options of a coupling that a device allows.
#include <gtest/gtest.h>

#include <cmath>
#include <limits>

#include "palpate/haptics/coupling.h"
#include "tests/haptics/coupled_box.h"

namespace palpate {
namespace {

using namespace test::coupled_box;  // NOLINT: all of it

TEST(CheckCoupling, FillsInWhatTheDeviceAllows) {
  const auto result = check_coupling({}, kLimits, kTick, box_tool());
  ASSERT_TRUE(result.has_value());
  const CouplingOptions& o = result->options;
  EXPECT_EQ(o.stiffness, 2000);
  EXPECT_EQ(o.angular_stiffness, 1);
  EXPECT_EQ(o.force_at_eighth, 10);
  EXPECT_EQ(o.damping_ratio, 1);
  EXPECT_TRUE(result->warnings.empty());
}

// Nobody has asked for the default damping ratio.
TEST(CheckCoupling, LowersTheDefaultDampingRatioWithoutAWord) {
  DeviceLimits limits = kLimits;
  limits.max_damping = 5;
  const auto result = check_coupling({}, limits, kTick, box_tool());
  ASSERT_TRUE(result.has_value());
  EXPECT_NEAR(result->options.damping_ratio, 5 / (2 * std::sqrt(0.1 * result->options.stiffness)),
              1e-12);
  EXPECT_LT(result->options.damping_ratio, 0.9);
  EXPECT_TRUE(result->warnings.empty()) << result->warnings[0];
  CouplingOptions options;
  options.damping_ratio = 1.1;
  EXPECT_EQ(check_coupling(options, limits, kTick, box_tool())->warnings.size(), 1u);
}

TEST(CheckCoupling, StaysBelowThePassivityBound) {
  CouplingOptions options;
  options.damping_ratio = 0;
  const auto pure = check_coupling(options, kLimits, 2 * kTick, box_tool());
  ASSERT_TRUE(pure.has_value());
  EXPECT_NEAR(pure->options.stiffness, 2 * kLimits.damping / (2 * kTick), 1e-6);
  // The coupling's damping 2 zeta sqrt(m K) counts too.
  options.damping_ratio = 0.01;
  const double k = check_coupling(options, kLimits, 2 * kTick, box_tool())->options.stiffness;
  EXPECT_NEAR(k, (1 + 0.02 * std::sqrt(0.1 * k)) / kTick, 1e-6);
}

/// A ball of this radius of gyration.
MassProperties ball_tool(double radius) {
  MassProperties tool{1e-6, {}, {}};
  for (int i = 0; i < 3; ++i) tool.inertia.m[i][i] = tool.volume * radius * radius;
  return tool;
}

TEST(CheckCoupling, StaysBelowThePassivityBoundOfTurningThisTool) {
  DeviceLimits limits = kLimits;
  limits.max_angular_stiffness = 50;
  for (const double radius : {0.0005, 0.002, 0.01}) {
    for (const double scale : {0.5, 1.0, 4.0}) {
      CouplingOptions options;
      options.motion_scale = scale;
      const auto result = check_coupling(options, limits, kTick, ball_tool(radius));
      ASSERT_TRUE(result) << result.error().message;
      // The tool of 0.1 kg is this large in the hand; K = 2 (b + 2 sqrt(I K)) / T.
      const double root_inertia = std::sqrt(0.1) * radius / scale;
      const double root = (4 * root_inertia + std::sqrt(16 * root_inertia * root_inertia +
                                                        8 * limits.angular_damping * kTick)) /
                          (2 * kTick);
      EXPECT_NEAR(result->options.angular_stiffness, std::min(50.0, root * root), 1e-6)
          << radius << " " << scale;
      EXPECT_TRUE(result->warnings.empty()) << result->warnings[0];
    }
  }
  // A stiffness that is passive for a long tool need not be so for a short one.
  CouplingOptions options;
  options.angular_stiffness = 20;
  EXPECT_TRUE(check_coupling(options, limits, kTick, ball_tool(0.05))->warnings.empty());
  const auto small = check_coupling(options, limits, kTick, ball_tool(0.001));
  ASSERT_EQ(small->warnings.size(), 1u);
  EXPECT_NE(small->warnings[0].find("angular coupling stiffness of 20 N m/rad is not passive"),
            std::string::npos)
      << small->warnings[0];
}

TEST(CheckCoupling, SaysWhatItLoweredAndWhatIsNotPassive) {
  CouplingOptions options;
  options.stiffness = 5000;
  auto result = check_coupling(options, kLimits, kTick, box_tool());
  ASSERT_TRUE(result.has_value());
  EXPECT_EQ(result->options.stiffness, 2000);
  ASSERT_EQ(result->warnings.size(), 1u);
  EXPECT_NE(result->warnings[0].find("lowered from 5e+03"), std::string::npos);

  options.stiffness = 1500;
  options.damping_ratio = 0;
  result = check_coupling(options, kLimits, 2 * kTick, box_tool());
  ASSERT_TRUE(result.has_value());
  EXPECT_EQ(result->options.stiffness, 1500);
  ASSERT_EQ(result->warnings.size(), 1u);
  EXPECT_NE(result->warnings[0].find("not passive: 2 b / T is 1e+03"), std::string::npos);

  options.damping_ratio = 3;
  result = check_coupling(options, kLimits, kTick, box_tool());
  ASSERT_TRUE(result.has_value());
  ASSERT_EQ(result->warnings.size(), 1u);
  EXPECT_NEAR(result->options.damping_ratio, 30 / (2 * std::sqrt(150.0)), 1e-12);

  CouplingOptions proxy;
  proxy.kind = CouplingKind::proxy;
  proxy.hold = ContactHold::interpolation;
  result = check_coupling(proxy, kLimits, kTick, box_tool());
  EXPECT_EQ(result->options.hold, ContactHold::local_model);
  EXPECT_EQ(result->warnings.size(), 1u);
}

TEST(CheckCoupling, RefusesWhatIsNoNumberOrOutOfRange) {
  const double nan = std::numeric_limits<double>::quiet_NaN();
  const auto is_refused = [](auto change) {
    CouplingOptions options;
    change(options);
    return !check_coupling(options, kLimits, kTick, box_tool()).has_value();
  };
  EXPECT_TRUE(is_refused([&](auto& o) { o.stiffness = nan; }));
  EXPECT_TRUE(is_refused([&](auto& o) { o.angular_stiffness = -1; }));
  EXPECT_TRUE(is_refused([&](auto& o) { o.tool_mass = 0; }));
  EXPECT_TRUE(is_refused([&](auto& o) { o.damping_ratio = -0.1; }));
  EXPECT_TRUE(is_refused([&](auto& o) { o.motion_scale = 0; }));
  EXPECT_TRUE(is_refused([&](auto& o) { o.X_WB.translation.x = nan; }));
  EXPECT_TRUE(is_refused([&](auto& o) { o.X_HT.rotation = {0, 0, 0, 0}; }));
  for (const double tick : {1e-6, 1.0}) {  // the first and the last
    EXPECT_TRUE(check_coupling({}, kLimits, tick, box_tool()).has_value()) << tick;
  }
  for (const double tick : {0.0, -kTick, 0.999e-6, 1.001, nan}) {
    EXPECT_FALSE(check_coupling({}, kLimits, tick, box_tool()).has_value()) << tick;
  }
  DeviceLimits broken = kLimits;
  broken.max_torque = nan;
  EXPECT_FALSE(check_coupling({}, broken, kTick, box_tool()).has_value());
}

TEST(CheckCoupling, ServesDevicesThatRenderNothing) {
  const auto result = check_coupling({}, {}, kTick, box_tool());
  ASSERT_TRUE(result.has_value()) << result.error().message;
  EXPECT_GT(result->options.stiffness, 0);
  EXPECT_GT(result->options.angular_stiffness, 0);
  EXPECT_GT(result->options.force_at_eighth, 0);
}

}  // namespace
}  // namespace palpate
