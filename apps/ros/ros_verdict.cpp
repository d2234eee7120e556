#include "apps/ros/ros_verdict.h"

#include <cstdio>

namespace palpate::apps {
namespace {

using State = RosContact::State;

std::string milliseconds(const char* format, double seconds) {
  char text[120];
  std::snprintf(text, sizeof text, format, 1e3 * seconds);
  return text;
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

}  // namespace palpate::apps
