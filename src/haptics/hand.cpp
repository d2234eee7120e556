#include "src/haptics/hand.h"

namespace palpate {
namespace {

/// No device reaches as far (m) or moves as fast (m/s, rad/s): more than that is a glitch.
constexpr double kFarthest = 1e3, kFastest = 1e3;

}  // namespace

void Hand::take_over(const CouplingState& state) noexcept {
  DeviceState last;
  last.X_BH = state.X_BH;
  last.is_valid = true;
  follow(last);
  shift_W_ = state.X_WT_hand.translation - held_.X_WT.translation;
  follow(last);
}

const HeldTool& Hand::follow(const DeviceState& state) noexcept {
  held_.velocity = {};
  if (!state.is_valid || !is_finite(state.X_BH)) return held_;
  if (!(norm(state.X_BH.translation) < kFarthest)) return held_;
  X_BH_ = state.X_BH;
  const double scale = options_.motion_scale;
  const Pose X_BH{scale * state.X_BH.translation, normalized(state.X_BH.rotation)};
  Pose X_WH = options_.X_WB * X_BH;
  X_WH.translation += shift_W_;
  held_.X_WT = X_WH * options_.X_HT;
  held_.p_WC = held_.X_WT * c_T_;
  held_.p_WH = X_WH.translation;
  if (!(norm(state.V_BH.linear) < kFastest && norm(state.V_BH.angular) < kFastest)) return held_;
  const Vec3d linear_W = rotate(options_.X_WB.rotation, scale * state.V_BH.linear);
  const Vec3d angular_W = rotate(options_.X_WB.rotation, state.V_BH.angular);
  held_.velocity = {linear_W + cross(angular_W, held_.p_WC - held_.p_WH), angular_W};
  return held_;
}

Wrench Hand::at_handle(const Wrench& F_C_W) const noexcept {
  const Quaternion q_BW = conjugate(options_.X_WB.rotation);
  const Vec3d torque_W = F_C_W.torque + cross(held_.p_WC - held_.p_WH, F_C_W.force);
  return {rotate(q_BW, F_C_W.force), rotate(q_BW, torque_W / options_.motion_scale)};
}

}  // namespace palpate
