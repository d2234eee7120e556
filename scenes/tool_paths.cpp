#include "scenes/tool_paths.h"

#include <algorithm>
#include <cmath>

namespace palpate { inline namespace v0 { namespace scenes {
namespace {

constexpr double kSamplesPerSecond = 50;
constexpr double kApproachTime = 0.5;       // s
constexpr double kApproachDistance = 0.02;  // m

/// From 0 at `start` to 1 at `end` without a jerk at either.
double eased(double t, double start, double end) {
  const double x = std::clamp((t - start) / (end - start), 0.0, 1.0);
  return x * x * x * (10 + x * (6 * x - 15));
}

}  // namespace

void set_path(Scene& scene, const Touch& touch) {
  scene.path_times.clear();
  scene.path_poses.clear();
  const int num_steps = static_cast<int>(std::lround(scene.duration * kSamplesPerSecond));
  for (int i = 0; i <= num_steps; ++i) {
    const double t = scene.duration * i / num_steps, share = t / scene.duration;
    const double pressed = eased(share, 0.05, 0.35) - eased(share, 0.7, 0.95);
    const double slid = eased(share, 0.3, 0.75);
    const double below = -touch.clearance + pressed * (touch.clearance + touch.depth);
    const Vec3d eight{touch.eight.x * std::sin(2 * kPi * slid),
                      touch.eight.y * std::sin(4 * kPi * slid), 0};
    const Vec3d p_S = touch.slide * (slid - 0.5) + eight + Vec3d{0, 0, below - touch.reach};
    const Quaternion turned =
        axis_angle({0, 0, 1}, touch.turn * slid) * axis_angle({1, 0, 0}, touch.tilt * (slid - 0.5));
    const Quaternion R_ST = normalized(turned * touch.R_ST);
    scene.path_times.push_back(t);
    scene.path_poses.push_back(touch.surface(t) * Pose{p_S - rotate(R_ST, touch.pivot), R_ST});
  }
}

void set_path(Scene& scene, const ThesisExperiment& experiment) {
  Pose before = experiment.start;
  before.translation.z -= kApproachDistance;
  scene.path_times = {0, kApproachTime, scene.duration};
  scene.path_poses = {before, experiment.start, experiment.end};
}

}}}  // namespace palpate::v0::scenes
