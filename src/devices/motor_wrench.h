// The final check of a wrench before it goes to a driver, and conversion of drivers' rotations.
#pragma once

#include <algorithm>
#include <cmath>

#include "palpate/haptics/device.h"
#include "src/math/internal/pose_of_matrix.h"

namespace palpate { inline namespace v0 {

/// `v`, shortened to `longest` if it is longer; zero if it is not finite.
inline Vec3d shortened(const Vec3d& v, double longest) {
  const double length = norm(v);
  if (!std::isfinite(length)) return {};
  return length > longest ? v * (longest / length) : v;
}

/// Returns the wrench for the motors: force and torque each within its limit, and zero if anything
/// is not finite. The safety filter has done so before; this is the last check.
inline Wrench motor_wrench(const Wrench& F, const DeviceLimits& limits) {
  if (!std::isfinite(norm(F.force) + norm(F.torque))) return {};
  return {shortened(F.force, limits.max_force), shortened(F.torque, limits.max_torque)};
}

/// Largest number of consecutive ticks without a usable state in which a device keeps its force:
/// one call that fails now and then is no fault.
inline constexpr int kPatientTicks = 5;

/// Share of the wrench that the motors get: none in a tick in which the device has no force, and
/// from there back to all of it in 0.2 s. DeviceState::has_force tells the safety filter, which
/// then takes the force away and ramps it itself; this ramp works even without it.
class MotorRamp {
 public:
  double next(bool has_force) noexcept {
    constexpr double kStep = 0.005;
    share_ = has_force ? std::min(share_ + kStep, 1.0) : 0;
    return share_;
  }
  double share() const noexcept { return share_; }  ///< as returned last by next()
  bool is_full() const noexcept { return share_ == 1; }
  void restart() noexcept { share_ = 1; }

 private:
  double share_ = 1;
};

/// True if a matrix is a rotation, up to the rounding of a device.
inline bool is_rotation(const Mat3d& R) {
  constexpr double kRounding = 0.01;
  const Vec3d x{R.m[0][0], R.m[1][0], R.m[2][0]}, y{R.m[0][1], R.m[1][1], R.m[2][1]},
      z{R.m[0][2], R.m[1][2], R.m[2][2]};
  const auto is_near = [](double a, double b) { return std::abs(a - b) < kRounding; };
  return is_near(dot(x, x), 1) && is_near(dot(y, y), 1) && is_near(dot(z, z), 1) &&
         is_near(dot(x, y), 0) && is_near(dot(y, z), 0) && is_near(dot(cross(x, y), z), 1);
}

}}  // namespace palpate::v0
