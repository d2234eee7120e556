#include "apps/ros/ros_verdict.h"

#include <algorithm>
#include <array>
#include <cstdio>

#include "src/math/internal/matrix.h"
#include "src/math/internal/matrix6.h"
#include "src/math/internal/wrench_transform.h"

namespace palpate::apps {
namespace {

using State = RosContact::State;

std::string milliseconds(const char* format, double seconds) {
  char text[120];
  std::snprintf(text, sizeof text, format, 1e3 * seconds);
  return text;
}

/// Returns a stiffness about p_W in the frame A: M K M^T with the map M of wrenches about p_W in W
/// to wrenches about the origin of A in A, which is that of transformed_to.
std::array<double, 36> stiffness_in(const Pose& X_WA, const Stiffness& K_W, const Vec3d& p_W) {
  const Vec3d r = p_W - X_WA.translation;
  const double lever[3][3] = {{0, -r.z, r.y}, {r.z, 0, -r.x}, {-r.y, r.x, 0}};
  const Quaternion q_AW = conjugate(X_WA.rotation);
  const Vec3d axes[3] = {rotate(q_AW, Vec3d{1, 0, 0}), rotate(q_AW, Vec3d{0, 1, 0}),
                         rotate(q_AW, Vec3d{0, 0, 1})};
  Mat6 map;  // maps wrenches about p_W in W to wrenches in A
  for (int i = 0; i < 3; ++i) {
    for (int j = 0; j < 3; ++j) {
      map.m[i][j] = map.m[3 + i][3 + j] = axes[j][i];
      for (int k = 0; k < 3; ++k) map.m[3 + i][j] += axes[k][i] * lever[k][j];
    }
  }
  std::array<double, 36> K;
  std::copy_n(congruent(map, K_W).m[0], 36, K.begin());
  return K;
}

}  // namespace

std::string RosVerdict::reason() const {
  switch (why) {
    case Why::none: return "";
    case Why::camera_is_lost: return "the camera is lost";
    case Why::gpu_is_lost: return "the GPU is lost";
    case Why::pose_is_old: return "the tool's pose is too old";
    case Why::nothing_measured: return "nothing has been measured yet";
    case Why::depth_is_old: return milliseconds("the depth image is %.0f ms old", depth_age);
    case Why::contact_is_old:
      return milliseconds("the last measurement is %.0f ms old", contact_age);
    case Why::not_measured: return "the tool could not be measured against the image";
    case Why::has_ended: return "the run has ended";
    case Why::no_thread: return "cannot start the publishing thread";
  }
  return "";
}

RosVerdict judge(const TickRecord& tick, double time, double max_age) {
  const double since = time - tick.device.time;
  const double depth_age = tick.sensor_age + since, contact_age = tick.contact_age + since;
  const auto because = [&](State state, RosVerdict::Why why) {
    return RosVerdict{state, why, depth_age, contact_age};
  };
  using Why = RosVerdict::Why;
  if (tick.has_sensor_failed) return because(State::failed, Why::camera_is_lost);
  if (tick.has_backend_failed) return because(State::failed, Why::gpu_is_lost);
  if (!tick.device.is_valid || since > max_age) return because(State::stale, Why::pose_is_old);
  if (tick.contact_number == 0) return because(State::stale, Why::nothing_measured);
  if (!(depth_age <= max_age)) return because(State::stale, Why::depth_is_old);
  if (!(contact_age <= max_age)) return because(State::stale, Why::contact_is_old);
  if (tick.penetration.status.is_unmeasured()) return because(State::failed, Why::not_measured);
  return because(State::valid, Why::none);
}

RosContact contact_of(const TickRecord& tick, const RosVerdict& verdict,
                      const ContactRecord& newest, const Tool& tool, double full_volume) {
  RosContact contact;
  contact.state = verdict.state;
  contact.reason = verdict.reason();
  contact.depth_age = verdict.depth_age;
  contact.contact_age = verdict.contact_age;
  contact.status = tick.penetration.status.bits;
  if (!verdict.is_valid()) return contact;
  contact.volume = tick.penetration.volume;
  contact.fraction = full_volume > 0 ? contact.volume / full_volume : 0;
  contact.unseen = full_volume > 0 ? tick.penetration.unseen_volume / full_volume : 0;
  contact.potential = tick.penetration.potential;
  const Pose& X_WT = tick.step.X_WT;
  contact.wrench =
      transformed_to(X_WT, tick.step.contact_W, X_WT * tool.sphere_mass().center_of_mass);
  const LocalContact& local = newest.contact;
  contact.max_stiffness = local.max_stiffness;
  contact.stiffness = stiffness_in(local.X_WT, local.stiffness, local.p_WC);
  if (!tick.noise) return contact;
  // A force that is zero has no noise to first order.
  const double measure = norm(newest.penetration.measure_W.force);
  const double newtons = measure > 0 ? norm(local.F_C_W.force) / measure : 0;
  const Mat3d R_TW = rotation_matrix(inverse(X_WT).rotation);
  MeasureNoise noise{0, congruent(R_TW, tick.noise->force), congruent(R_TW, tick.noise->torque)};
  contact.volume_std = tick.noise->volume_std();
  contact.force_std = newtons * noise.force_std();
  contact.torque_std = newtons * noise.torque_std();
  return contact;
}

}  // namespace palpate::apps
