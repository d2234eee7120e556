#include "src/haptics/coupling/spring.h"

#include <algorithm>

#include "src/math/internal/rotation_vector.h"

namespace palpate { inline namespace v0 {
namespace {

double rate(double stiffness, double limit, double stretch) {
  return stiffness * stretch > limit ? limit / stretch : stiffness;
}

double energy_of(double stiffness, double limit, double stretch) {
  const double elastic = std::min(stretch, limit / stiffness);
  return stiffness * elastic * (stretch - elastic / 2);
}

}  // namespace

Spring::Rates Spring::rates(const Vec6& stretch) const {
  return {rate(stiffness, max_force, norm(stretch.linear)),
          rate(angular_stiffness, max_torque, norm(stretch.angular))};
}

double Spring::energy(const Vec6& stretch) const {
  return energy_of(stiffness, max_force, norm(stretch.linear)) +
         energy_of(angular_stiffness, max_torque, norm(stretch.angular));
}

Spring make_spring(const CouplingOptions& options, const DeviceLimits& limits) {
  Spring spring;
  spring.stiffness = options.stiffness / options.motion_scale;
  spring.angular_stiffness = options.angular_stiffness * options.motion_scale;
  if (limits.max_force > 0) spring.max_force = limits.max_force;
  if (limits.max_torque > 0) spring.max_torque = limits.max_torque * options.motion_scale;
  return spring;
}

Vec6 stretch_between(const Pose& X_WT, const Vec3d& p_WC, const HeldTool& held) {
  return {held.p_WC - p_WC, rotation_between(X_WT.rotation, held.X_WT.rotation)};
}

}}  // namespace palpate::v0
