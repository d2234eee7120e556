#include "src/devices/open_haptics/open_haptics_servo.h"

#include <cmath>
#include <utility>

#include "src/core/internal/bounded_call.h"
#include "src/core/internal/monotonic_clock.h"
#include "src/devices/device_pose.h"

namespace palpate { inline namespace v0 {
namespace {

constexpr double kMetersPerMillimeter = 1e-3, kMillinewtonMeters = 1e3;  // per N m
constexpr int kRestTicks = 100;
constexpr int kMaxWearyTicks = 5000;  // in a row: then it is hopeless

Vec3d vector(const double* v) { return {v[0], v[1], v[2]}; }

}  // namespace

OpenHapticsServo::OpenHapticsServo(const OpenHapticsApi& api, HdHandle device,
                                   const DeviceInfo& info, DeviceTick tick)
    : api_(api),
      device_(device),
      limits_(info.limits),
      senses_orientation_(info.senses_orientation),
      tick_(std::move(tick)) {}

unsigned OpenHapticsServo::call_back(void* servo) noexcept {
  return static_cast<OpenHapticsServo*>(servo)->frame();
}

void OpenHapticsServo::give_up(std::shared_ptr<OpenHapticsServo> self) noexcept {
  door_.close();
  self_ = std::move(self);
  Life expected = Life::running;
  if (life_.compare_exchange_strong(expected, Life::given_up)) {
    count_hung_calls(1);
  } else if (expected == Life::ended) {
    self_.reset();  // the servo has ended: the driver does not need it
  }
}

/// Marks the end. A thread that sees it may free the servo.
void OpenHapticsServo::end() noexcept {
  if (life_.exchange(Life::ended) != Life::given_up) return;
  const auto self = std::move(self_);  // freed at the return
  count_hung_calls(-1);
}

unsigned OpenHapticsServo::frame() noexcept {
  if (has_ended()) return kHdCallbackDone;
  num_weary_ = rest_ > 0 ? num_weary_ + 1 : 0;
  if (rest_ > 0) --rest_;

  api_.hdBeginFrame(device_);
  read();
  num_unusable_ = state_.is_valid ? 0 : num_unusable_ + 1;
  const bool has_force = rest_ == 0 && num_unusable_ <= kPatientTicks;
  state_.has_force = has_force && ramp_.is_full();
  const bool is_last =
      failure() != 0 || wants_end_.load(std::memory_order_acquire) || !door_.enter();
  Wrench F_H_B;
  if (!is_last) {
    F_H_B = tick_(state_);
    door_.leave();
  }
  const double share = ramp_.next(has_force);
  write({share * F_H_B.force, share * F_H_B.torque});
  api_.hdEndFrame(device_);
  judge(api_.take_errors().code);

  last_time_.store(state_.time, std::memory_order_release);
  if (!is_last) return kHdCallbackContinue;
  end();
  return kHdCallbackDone;
}

/// The transform is column by column, its translation in millimeters. Its axes are those of B
/// (HD_CURRENT_POSITION: "Right is +x, up is +y, toward user is +z").
void OpenHapticsServo::read() noexcept {
  double m[16] = {}, v[3] = {}, w[3] = {};
  int buttons = 0;
  state_.time = monotonic_now();
  api_.hdGetDoublev(kHdTransform, m);
  api_.hdGetDoublev(kHdVelocity, v);
  if (senses_orientation_) api_.hdGetDoublev(kHdAngularVelocity, w);
  api_.hdGetIntegerv(kHdButtons, &buttons);
  const HdEnum error = api_.take_errors().code;
  judge(error);

  Pose X_BH{vector(m + 12) * kMetersPerMillimeter, {}};
  Mat3d R = rotation_matrix({});
  if (senses_orientation_) {
    R = {{{m[0], m[4], m[8]}, {m[1], m[5], m[9]}, {m[2], m[6], m[10]}}};
    X_BH.rotation = quaternion_of(R);
  }
  const Twist V_BH{vector(v) * kMetersPerMillimeter, vector(w)};
  state_.is_valid = (error == 0 || is_force_error(error)) && is_possible(X_BH) && is_rotation(R) &&
                    std::isfinite(norm(V_BH.linear) + norm(V_BH.angular));
  if (!state_.is_valid) return;
  state_.X_BH = X_BH;
  state_.V_BH = V_BH;
  state_.buttons = static_cast<std::uint32_t>(buttons);
}

void OpenHapticsServo::write(const Wrench& F_H_B) noexcept {
  const Wrench F = motor_wrench(F_H_B, limits_);
  const double force[3] = {F.force.x, F.force.y, F.force.z};
  api_.hdSetDoublev(kHdForce, force);
  if (limits_.max_torque <= 0) return;
  const Vec3d t = F.torque * kMillinewtonMeters;
  const double torque[3] = {t.x, t.y, t.z};
  api_.hdSetDoublev(kHdTorque, torque);
}

void OpenHapticsServo::judge(HdEnum code) noexcept {
  if (code == 0) return;
  if (is_force_error(code)) rest_ = kRestTicks;
  const bool is_serious = !is_force_error(code) || num_weary_ > kMaxWearyTicks;
  if (is_serious && failure() == 0) failure_.store(code, std::memory_order_release);
}

}}  // namespace palpate::v0
