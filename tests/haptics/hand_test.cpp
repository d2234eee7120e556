// The tool in the hand, held to finite differences.
#include "src/haptics/internal/hand.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <utility>

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

TEST(Hand, TheVelocityOfTheToolIsThatOfItsCenterOfMass) {
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

/// The time of a tick that brings no pose.
DeviceState nothing_at(double time) {
  DeviceState state;
  state.time = time;
  state.X_BH = {{7, 8, 9}, axis_angle({1, 0, 0}, 1)};
  return state;
}

double apart(const Pose& a, const Pose& b) {
  return norm(a.translation - b.translation) +
         norm(rotation_vector(a.rotation * conjugate(b.rotation)));
}

// The device's next answer is where the hand was expected, at its pace; the hand of a device that
// is silent for long stands still.
TEST(Hand, GoesOnInTicksWithoutAState) {
  const Vec3d c_T{0.01, -0.02, 0.05};
  Hand hand(held_askew(), c_T), seen(held_askew(), c_T);
  hand.follow(handle_at(0.2));
  for (int k = 1; k < 10; ++k) {
    const double time = 0.2 + 1e-3 * k;
    const HeldTool& held = hand.follow(nothing_at(time));
    const HeldTool& expected = seen.follow(handle_at(time));
    EXPECT_LT(apart(held.X_WT, expected.X_WT), 1e-13) << k;
    EXPECT_LT(norm(held.velocity.linear - expected.velocity.linear), 1e-13) << k;
    EXPECT_EQ(held.velocity.angular, expected.velocity.angular);
    EXPECT_LT(apart(hand.X_BH(), handle_at(time).X_BH), 1e-13);
  }
  for (const double time : {0.211, 0.5, 30.0}) {
    const HeldTool& held = hand.follow(nothing_at(time));
    EXPECT_LT(apart(held.X_WT, seen.follow(handle_at(0.21)).X_WT), 1e-13) << time;
    EXPECT_EQ(norm(held.velocity.linear) + norm(held.velocity.angular), 0) << time;
  }
  // A time that is none, or lies before the last state, changes nothing.
  hand.follow(handle_at(0.4));
  for (const double time : {std::nan(""), 0.3}) {
    EXPECT_EQ(hand.follow(nothing_at(time)).X_WT, seen.follow(handle_at(0.4)).X_WT);
    EXPECT_EQ(norm(hand.held().velocity.linear), 0);
  }
}

// A spring and a damper between hand and tool feel no kick, wherever states are missing.
TEST(Hand, FeelsNothingInFreeAirFromADeviceThatLeavesOutTicks) {
  const DeviceLimits limits{.max_force = 8, .max_stiffness = 1000, .max_damping = 6, .damping = 1};
  MassProperties tool{1e-4, {0.05, 0, 0.01}, {}};
  for (int i = 0; i < 3; ++i) tool.inertia.m[i][i] = 1e-4 * 0.02 * 0.02;
  for (const CouplingKind kind : {CouplingKind::virtual_coupling, CouplingKind::proxy}) {
    for (const int period : {2, 4, 9}) {  // ticks from state to state
      CouplingOptions options;
      options.kind = kind;
      options = check_coupling(options, limits, 1e-3, tool)->options;
      const auto coupling = make_coupling(options, limits, tool);
      double most = 0;
      for (int k = 0; k < 1000; ++k) {
        const double time = 1e-3 * k;
        DeviceState state = nothing_at(time);
        if (k % period == 0) {
          state.X_BH = {{0.3 * time, 0, 0}, {}};
          state.V_BH.linear = {0.3, 0, 0};
          state.is_valid = true;
        }
        if (k == 0) coupling->reset(state);
        const CouplingStep step = coupling->step(state, {}, 1e-3);
        if (k > 800) most = std::max(most, norm(step.desired_F_H_B.force));  // it began at rest
      }
      EXPECT_LT(most, 1e-6) << static_cast<int>(kind) << " " << period;
    }
  }
}

// While the hand has let go, the tool does not move, and gives no force; from then on it makes the
// hand's motions from where it is.
TEST(Hand, LetsGoAndTakesHoldAgain) {
  CouplingOptions options = held_askew();
  options.clutch_button = 2;
  Hand hand(options, {0.01, -0.02, 0.05});
  const Pose before = hand.follow(handle_at(0.2)).X_WT;
  DeviceState state = handle_at(0.3);
  state.buttons = 0b10;
  for (const double time : {0.3, 0.5, 0.9}) {
    state.X_BH = handle_at(time).X_BH;
    const HeldTool& held = hand.follow(state);
    EXPECT_EQ(held.X_WT, before);
    EXPECT_EQ(norm(held.velocity.linear) + norm(held.velocity.angular), 0);
    const Wrench felt = hand.at_handle({{1, 2, 3}, {4, 5, 6}});
    EXPECT_EQ(norm(felt.force) + norm(felt.torque), 0);
  }
  state.buttons = 0b01;  // another one
  EXPECT_LT(apart(hand.follow(state).X_WT, before), 1e-14);
  EXPECT_GT(norm(hand.at_handle({{1, 2, 3}, {}}).force), 1);
  // The same motion of the hand, without a clutch in between.
  Hand other(options, {0.01, -0.02, 0.05});
  const auto turn_of = [](const Pose& a, const Pose& b) {
    return b.rotation * conjugate(a.rotation);
  };
  const Pose from = other.follow(handle_at(0.9)).X_WT, to = other.follow(handle_at(1)).X_WT;
  const HeldTool& now = hand.follow(handle_at(1));
  EXPECT_LT(norm(rotation_vector(turn_of(before, now.X_WT) * conjugate(turn_of(from, to)))), 1e-14);
  // Power is kept after it, too: torques are about where the handle is to the tool now.
  const Wrench F_C_W{{1, -2, 3}, {0.1, 0.4, -0.2}};
  const Wrench F_H_B = hand.at_handle(F_C_W);
  const Twist V_BH = handle_at(1).V_BH;
  EXPECT_NEAR(
      dot(F_C_W.force, now.velocity.linear) + dot(F_C_W.torque, now.velocity.angular),
      options.motion_scale * (dot(F_H_B.force, V_BH.linear) + dot(F_H_B.torque, V_BH.angular)),
      1e-12);
}

TEST(Hand, TheClutchAsASettingTakesOver) {
  CouplingOptions options = held_askew();
  Hand holding(options, {});
  const Pose before = holding.follow(handle_at(0.2)).X_WT;
  options.clutch = true;
  Hand free(options, {});
  free.take_over({holding.X_BH(), holding.held().X_WT, {}, {}, {}});
  EXPECT_LT(apart(free.follow(handle_at(0.6)).X_WT, before), 1e-14);
  options.clutch = false;
  options.motion_scale = 0.5;
  Hand again(options, {});
  again.take_over({free.X_BH(), free.held().X_WT, {}, {}, {}});
  EXPECT_LT(apart(again.follow(handle_at(0.6)).X_WT, before), 1e-14);
  const Vec3d first = again.follow(handle_at(0.6)).p_WH;
  const Vec3d way = again.follow(handle_at(0.7)).p_WH - first;
  const Vec3d expected = rotate(options.X_WB.rotation, 0.5 * 0.1 * handle_at(0).V_BH.linear);
  EXPECT_LT(norm(way - expected), 1e-14);
}

// The held tool stays in its box; what the hand feels there is the gradient of a spring's energy.
TEST(Hand, WallsKeepTheToolInItsWorkspace) {
  CouplingOptions options = held_askew();
  options.wall_stiffness = 300;
  options.workspace_x = 0.05;
  options.workspace_z = 0.08;
  Hand hand(options, {0.01, -0.02, 0.05});
  const auto energy = [&](const Pose& X_BH) {
    Vec3d p_B =
        options.motion_scale * X_BH.translation + rotate(X_BH.rotation, options.X_HT.translation);
    double sum = 0;
    for (const auto& [axis, half] : {std::pair{0, 0.05}, std::pair{2, 0.08}}) {
      const double over = std::max(std::abs(p_B[axis]) - half, 0.0);
      // As the hand sees it: its world is 1 / scale times as large.
      sum += 0.5 * 300 / options.motion_scale * over * over / options.motion_scale;
    }
    return sum;
  };
  int num_outside = 0;
  for (double time = -0.4; time < 0.4; time += 0.02) {
    const DeviceState state = handle_at(time);
    const HeldTool held = hand.follow(state);
    const Vec3d p_B = inverse(options.X_WB) * held.X_WT.translation;
    EXPECT_LE(std::abs(p_B.x), 0.05 + 1e-12);
    EXPECT_LE(std::abs(p_B.z), 0.08 + 1e-12);
    const Wrench felt = hand.at_handle({});
    constexpr double kStep = 1e-6;
    double power = dot(felt.force, state.V_BH.linear) + dot(felt.torque, state.V_BH.angular);
    const double rise =
        (energy(handle_at(time + kStep).X_BH) - energy(handle_at(time - kStep).X_BH)) / (2 * kStep);
    EXPECT_NEAR(power, -rise, 1e-5) << time;
    num_outside += energy(state.X_BH) > 0;
    // The velocity is that of the tool that is kept inside.
    const Vec3d was = hand.follow(handle_at(time - 1e-5)).p_WC;
    const Vec3d will_be = hand.follow(handle_at(time + 1e-5)).p_WC;
    EXPECT_LT(norm((will_be - was) / 2e-5 - held.velocity.linear), 1e-6) << time;
  }
  EXPECT_GT(num_outside, 10);
  // A wall across one axis alone.
  for (int axis = 0; axis < 3; ++axis) {
    CouplingOptions one = held_askew();
    one.wall_stiffness = 300;
    (axis == 0 ? one.workspace_x : axis == 1 ? one.workspace_y : one.workspace_z) = 1e-3;
    Hand between(one, {});
    for (double time = -0.4; time < 0.4; time += 0.1) {
      const Pose X_WT = between.follow(handle_at(time)).X_WT;
      EXPECT_LE(std::abs((inverse(one.X_WB) * X_WT.translation)[axis]), 1e-3 + 1e-12);
    }
  }
  options.kind = CouplingKind::none;  // a robot has the tool where it is
  EXPECT_GT(
      norm((inverse(options.X_WB) * Hand(options, {}).follow(handle_at(0.4)).X_WT).translation),
      0.2);
}

/// Computes the speed of a handle of 45 g after two seconds against a wall of the workspace, if a
/// hand pushes it there with 1 N and damps it by 0.3 N s/m, in addition to the device.
double speed_at_the_wall(const DeviceLimits& limits) {
  constexpr double kTick = 1e-3, kMass = 0.045, kPush = 1, kWall = 0.05;
  constexpr int kSubsteps = 100;
  CouplingOptions options;
  options.workspace_x = kWall;
  MassProperties tool{1e-6, {}, {}};
  for (int i = 0; i < 3; ++i) tool.inertia.m[i][i] = 1e-10;
  const auto checked = check_coupling(options, limits, kTick, tool);
  EXPECT_TRUE(checked.has_value());
  EXPECT_TRUE(checked->warnings.empty());
  const auto coupling = make_coupling(checked->options, limits, tool);
  DeviceState state;
  state.is_valid = true;
  state.X_BH.translation.x = kWall;
  coupling->reset(state);
  double fastest = 0;
  for (int i = 0; i < 3000; ++i) {
    state.time = kTick * i;
    const double force = coupling->step(state, {}, kTick).desired_F_H_B.force.x + kPush;
    double& x = state.X_BH.translation.x;
    double& v = state.V_BH.linear.x;
    for (int k = 0; k < kSubsteps; ++k) {
      v += (force - (limits.damping + 0.3) * v) * (kTick / kSubsteps / kMass);
      x += v * (kTick / kSubsteps);
    }
    if (i > 2000) fastest = std::max(fastest, std::abs(v));
  }
  return fastest;
}

// A driver may name a stiffness that its mechanism damps by far too little for.
TEST(Hand, AWallIsNoStifferThanTheMechanismDamps) {
  DeviceLimits limits{.max_force = 8, .max_stiffness = 1500, .max_damping = 4, .damping = 0.2};
  EXPECT_LT(speed_at_the_wall(limits), 1e-3);
  limits.max_stiffness = 300;  // less than 2 b / T
  EXPECT_LT(speed_at_the_wall(limits), 1e-3);
  CouplingOptions options;
  options.motion_scale = 3;
  const MassProperties tool{1e-6, {}, {}};
  EXPECT_DOUBLE_EQ(check_coupling(options, limits, 1e-3, tool)->options.wall_stiffness, 300);
  EXPECT_DOUBLE_EQ(check_coupling(options, limits, 2e-3, tool)->options.wall_stiffness, 200);
}

// Whatever the pose of the camera: to the right in the hand is to the right in its picture.
TEST(Hand, MovesAsInThePictureOfTheCamera) {
  const Pose X_WC{{1, 2, 3}, axis_angle({3, -1, 2}, 1.1)};
  const Pose X_WT{{0.2, -0.1, 0.7}, axis_angle({1, 1, -2}, 0.8)};
  CouplingOptions options;
  place_hand(X_WC, X_WT, options);
  Hand hand(options, {});
  DeviceState state;
  state.is_valid = true;
  EXPECT_LT(apart(hand.follow(state).X_WT, X_WT), 1e-14);
  const auto moved_C = [&](const Vec3d& p_BH) {
    state.X_BH.translation = p_BH;
    const Vec3d way_W = hand.follow(state).X_WT.translation - X_WT.translation;
    return rotate(conjugate(X_WC.rotation), way_W);
  };
  EXPECT_LT(norm(moved_C({0.1, 0, 0}) - Vec3d{0.1, 0, 0}), 1e-14);   // right
  EXPECT_LT(norm(moved_C({0, 0.1, 0}) - Vec3d{0, -0.1, 0}), 1e-14);  // up
  EXPECT_LT(norm(moved_C({0, 0, 0.1}) - Vec3d{0, 0, -0.1}), 1e-14);  // towards the hand: nearer
}

}  // namespace
}  // namespace palpate
