#include "src/haptics/internal/hand.h"

#include <algorithm>

#include "src/math/internal/rotation_vector.h"

namespace palpate { inline namespace v0 {
namespace {

/// Reach (m) and speed (m/s, rad/s) beyond any device: larger readings are glitches.
constexpr double kFarthest = 1e3, kFastest = 1e3;
/// Longest extrapolation of the hand's motion, s: as long as the default of
/// safety.max_device_silence.
constexpr double kLongestGap = 0.01;

}  // namespace

Hand::Hand(const CouplingOptions& options, const Vec3d& center_of_mass_T)
    : options_(options), c_T_(center_of_mass_T), X_HT_inverse_(inverse(options.X_HT)) {
  // Without a coupling the device's pose is that of the tool: no clutch, no walls.
  if (options.kind != CouplingKind::none) return;
  options_.clutch = false;
  options_.clutch_button = 0;
  options_.workspace_x = options_.workspace_y = options_.workspace_z = 0;
}

void Hand::take_over(const CouplingState& state) noexcept {
  X_BH_ = seen_X_BH_ = state.X_BH;
  V_BH_ = {};
  hold(state.X_WT_hand);
  place(X_BH_);
  held_.velocity = {};
  has_pose_ = true;
}

const HeldTool& Hand::follow(const DeviceState& state) noexcept {
  held_.velocity = {};
  if (!is_usable(state)) {
    go_on(state.time);
    return held_;
  }
  X_BH_ = seen_X_BH_ = state.X_BH;
  seen_time_ = state.time;
  const bool is_steady = norm(state.V_BH.linear) < kFastest && norm(state.V_BH.angular) < kFastest;
  V_BH_ = is_steady ? state.V_BH : Twist{};
  const bool is_clutched = has_pose_ && is_clutch_pressed(state);
  if (is_clutched_ && !is_clutched) hold(held_.X_WT);
  is_clutched_ = is_clutched;
  if (is_clutched) return held_;
  has_pose_ = true;
  place(X_BH_);
  held_.velocity = velocity_of(V_BH_);
  return held_;
}

Pose Hand::held_by(const DeviceState& state) const noexcept {
  Hand then = *this;
  return then.follow(state).X_WT;
}

bool Hand::is_usable(const DeviceState& state) const noexcept {
  return state.is_valid && is_finite(state.X_BH) && norm(state.X_BH.translation) < kFarthest;
}

/// Extrapolates the hand from the last usable state to a time of the device's clock. A hand that
/// stood still in between would pull at the coupling's damper.
void Hand::go_on(double time) noexcept {
  const double gap = time - seen_time_;
  if (!has_pose_ || is_clutched_ || !(gap >= 0)) return;
  const double counted = std::min(gap, kLongestGap);
  X_BH_ = {seen_X_BH_.translation + counted * V_BH_.linear,
           rotated(seen_X_BH_.rotation, counted * V_BH_.angular)};
  place(X_BH_);
  if (gap <= kLongestGap) held_.velocity = velocity_of(V_BH_);
}

/// Returns the velocity of the held tool, with the handle where it is.
Vec6 Hand::velocity_of(const Twist& V_BH) const noexcept {
  const Vec3d linear_W = rotate(options_.X_WB.rotation, options_.motion_scale * V_BH.linear);
  const Vec3d angular_W = rotate(options_.X_WB.rotation, V_BH.angular);
  Vec6 velocity{linear_W + cross(angular_W, held_.p_WC - held_.p_WH), angular_W};
  if (excess_B_ == Vec3d{}) return velocity;
  // Velocity of the tool's origin, which the walls let move only along themselves.
  const Vec3d origin_W = linear_W + cross(angular_W, held_.X_WT.translation - held_.p_WH);
  Vec3d stopped_B = rotate(conjugate(options_.X_WB.rotation), origin_W);
  for (int axis = 0; axis < 3; ++axis) {
    if (excess_B_[axis] == 0) stopped_B[axis] = 0;
  }
  velocity.linear = velocity.linear - rotate(options_.X_WB.rotation, stopped_B);
  return velocity;
}

bool Hand::is_clutch_pressed(const DeviceState& state) const noexcept {
  const int button = options_.clutch_button;
  return options_.clutch || (button > 0 && ((state.buttons >> (button - 1)) & 1u) != 0);
}

/// Sets the offset that puts the tool at X_WT with the handle where it is.
void Hand::hold(const Pose& X_WT) noexcept {
  const Pose X_WH = X_WT * X_HT_inverse_;
  const Quaternion hand = options_.X_WB.rotation * normalized(X_BH_.rotation);
  turn_ = normalized(conjugate(hand) * X_WH.rotation);
  shift_W_ = X_WH.translation - options_.X_WB * (options_.motion_scale * X_BH_.translation);
}

void Hand::place(const Pose& X_BH_now) noexcept {
  const Pose X_BH{options_.motion_scale * X_BH_now.translation, normalized(X_BH_now.rotation)};
  Pose X_WH = options_.X_WB * X_BH;
  X_WH.rotation = X_WH.rotation * turn_;
  X_WH.translation += shift_W_;
  held_.X_WT = X_WH * options_.X_HT;
  held_.p_WH = X_WH.translation;
  excess_B_ = beyond_workspace(held_.X_WT.translation);
  if (!(excess_B_ == Vec3d{})) {
    const Vec3d excess_W = rotate(options_.X_WB.rotation, excess_B_);
    held_.X_WT.translation -= excess_W;
    held_.p_WH -= excess_W;
  }
  held_.p_WC = held_.X_WT * c_T_;
}

/// Returns the offset of a point from the nearest one of the workspace, in B.
Vec3d Hand::beyond_workspace(const Vec3d& p_W) const noexcept {
  const double half[] = {options_.workspace_x, options_.workspace_y, options_.workspace_z};
  if (half[0] == 0 && half[1] == 0 && half[2] == 0) return {};
  const Vec3d p_B = rotate(conjugate(options_.X_WB.rotation), p_W - options_.X_WB.translation);
  Vec3d beyond_B;
  for (int axis = 0; axis < 3; ++axis) {
    if (half[axis] > 0) beyond_B[axis] = p_B[axis] - std::clamp(p_B[axis], -half[axis], half[axis]);
  }
  return beyond_B;
}

double Hand::wall_energy() const noexcept {
  return wall_stiffness() / 2 * dot(excess_B_, excess_B_);
}

Wrench Hand::at_handle(const Wrench& F_C_W) const noexcept {
  if (is_clutched_) return {};
  const Quaternion q_BW = conjugate(options_.X_WB.rotation);
  // The walls of the workspace are springs, as stiff as the one that holds the tool.
  const Vec3d wall_W = rotate(options_.X_WB.rotation, -wall_stiffness() * excess_B_);
  const Vec3d torque_W = F_C_W.torque + cross(held_.p_WC - held_.p_WH, F_C_W.force) +
                         cross(held_.X_WT.translation - held_.p_WH, wall_W);
  return {rotate(q_BW, F_C_W.force + wall_W), rotate(q_BW, torque_W / options_.motion_scale)};
}

}}  // namespace palpate::v0
