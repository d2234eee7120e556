#include "src/haptics/hand.h"

#include <algorithm>

namespace palpate::inline v0 {
namespace {

/// No device reaches as far (m) or moves as fast (m/s, rad/s): more than that is a glitch.
constexpr double kFarthest = 1e3, kFastest = 1e3;

}  // namespace

Hand::Hand(const CouplingOptions& options, const Vec3d& centre_of_mass_T)
    : options_(options), c_T_(centre_of_mass_T), X_HT_inverse_(inverse(options.X_HT)) {
  // Who holds the tool otherwise than by this hand has it where it is.
  if (options.kind != CouplingKind::none) return;
  options_.clutch = false;
  options_.clutch_button = 0;
  options_.workspace_x = options_.workspace_y = options_.workspace_z = 0;
}

void Hand::take_over(const CouplingState& state) noexcept {
  X_BH_ = state.X_BH;
  hold(state.X_WT_hand);
  place(X_BH_);
  held_.velocity = {};
  has_pose_ = true;
}

const HeldTool& Hand::follow(const DeviceState& state) noexcept {
  held_.velocity = {};
  if (!state.is_valid || !is_finite(state.X_BH)) return held_;
  if (!(norm(state.X_BH.translation) < kFarthest)) return held_;
  X_BH_ = state.X_BH;
  const bool is_clutched = has_pose_ && is_clutch_pressed(state);
  if (is_clutched_ && !is_clutched) hold(held_.X_WT);
  is_clutched_ = is_clutched;
  if (is_clutched) return held_;
  has_pose_ = true;
  place(X_BH_);
  if (!(norm(state.V_BH.linear) < kFastest && norm(state.V_BH.angular) < kFastest)) return held_;
  const double scale = options_.motion_scale;
  const Vec3d linear_W = rotate(options_.X_WB.rotation, scale * state.V_BH.linear);
  const Vec3d angular_W = rotate(options_.X_WB.rotation, state.V_BH.angular);
  held_.velocity = {linear_W + cross(angular_W, held_.p_WC - held_.p_WH), angular_W};
  if (excess_B_ == Vec3d{}) return held_;
  // Of the tool's origin, which goes on along the walls alone.
  const Vec3d origin_W = linear_W + cross(angular_W, held_.X_WT.translation - held_.p_WH);
  Vec3d stopped_B = rotate(conjugate(options_.X_WB.rotation), origin_W);
  for (int axis = 0; axis < 3; ++axis) {
    if (excess_B_[axis] == 0) stopped_B[axis] = 0;
  }
  held_.velocity.linear = held_.velocity.linear - rotate(options_.X_WB.rotation, stopped_B);
  return held_;
}

bool Hand::is_clutch_pressed(const DeviceState& state) const noexcept {
  const int button = options_.clutch_button;
  return options_.clutch || (button > 0 && ((state.buttons >> (button - 1)) & 1u) != 0);
}

/// The tool is to be there with the handle where it is.
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

/// How far a point is outside, from the nearest one that is not, in B.
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

Wrench Hand::at_handle(const Wrench& F_C_W) const noexcept {
  if (is_clutched_) return {};
  const Quaternion q_BW = conjugate(options_.X_WB.rotation);
  const double stiffness = options_.wall_stiffness / options_.motion_scale;
  const Vec3d wall_W = rotate(options_.X_WB.rotation, -stiffness * excess_B_);
  const Vec3d torque_W = F_C_W.torque + cross(held_.p_WC - held_.p_WH, F_C_W.force) +
                         cross(held_.X_WT.translation - held_.p_WH, wall_W);
  return {rotate(q_BW, F_C_W.force + wall_W), rotate(q_BW, torque_W / options_.motion_scale)};
}

}  // namespace palpate::inline v0
