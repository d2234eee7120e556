// The tool in the hand, held to finite differences.
#include "src/haptics/hand.h"

#include <gtest/gtest.h>

#include "src/math/internal/rotation_vector.h"

namespace palpate {
namespace {

CouplingOptions held_askew() {
  CouplingOptions options;
  options.motion_scale = 2.5;
  options.X_WB = {{0.1, -0.2, 0.4}, axis_angle({1, 2, 3}, 0.9)};
  options.X_HT = {{0.03, 0.01, -0.12}, axis_angle({-1, 0.5, 0.2}, 0.6)};
  return options;
}

/// A handle that moves and turns steadily.
DeviceState handle_at(double time) {
  const Vec3d linear{0.2, -0.1, 0.3}, angular{2, -1, 3};
  DeviceState state;
  state.time = time;
  state.X_BH = {Vec3d{0.01, 0.02, 0.03} + time * linear,
                axis_angle(angular, norm(angular) * time) * axis_angle({0, 1, 1}, 0.4)};
  state.V_BH = {linear, angular};
  state.is_valid = true;
  return state;
}

TEST(Hand, TheVelocityOfTheToolIsThatOfItsCentreOfMass) {
  Hand hand(held_askew(), {0.01, -0.02, 0.05});
  constexpr double kStep = 1e-5;
  const HeldTool before = hand.follow(handle_at(0.2 - kStep));
  const HeldTool after = hand.follow(handle_at(0.2 + kStep));
  const HeldTool now = hand.follow(handle_at(0.2));
  const Vec3d linear = (after.p_WC - before.p_WC) / (2 * kStep);
  const Vec3d angular =
      rotation_vector(after.X_WT.rotation * conjugate(before.X_WT.rotation)) / (2 * kStep);
  EXPECT_LT(norm(now.velocity.linear - linear), 1e-7);
  EXPECT_LT(norm(now.velocity.angular - angular), 1e-7);
}

// Whatever power the tool gives to the hand's side of the coupling arrives at the handle.
TEST(Hand, ForcesAtTheHandleDoTheWorkOfThoseAtTheTool) {
  const CouplingOptions options = held_askew();
  Hand hand(options, {0.01, -0.02, 0.05});
  const DeviceState state = handle_at(0.2);
  const HeldTool tool = hand.follow(state);
  const Wrench F_C_W{{1, -2, 3}, {0.1, 0.4, -0.2}};
  const Wrench F_H_B = hand.at_handle(F_C_W);
  const double at_tool =
      dot(F_C_W.force, tool.velocity.linear) + dot(F_C_W.torque, tool.velocity.angular);
  const double at_handle = options.motion_scale * (dot(F_H_B.force, state.V_BH.linear) +
                                                   dot(F_H_B.torque, state.V_BH.angular));
  EXPECT_NEAR(at_tool, at_handle, 1e-12);
}

}  // namespace
}  // namespace palpate
