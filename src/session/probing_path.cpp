#include "palpate/session/probing_path.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "palpate/math/sphere.h"
#include "src/session/coarse_depth.h"

namespace palpate {
namespace {

constexpr double kFraction = 0.1;  // of the tool's volume behind the surface at full depth
constexpr double kPoseRate = 100;  // poses per second
constexpr double kLean = 0.45;     // rad, between the tool's axis and the viewing ray
constexpr double kMaxTurn = 0.3;   // rad, about the viewing ray

/// Where the tool will touch, and where its slide ends: two neighbouring cells.
struct Target {
  int column = 0, row = 0, end_column = 0;
};

/// The pair of neighbours on the calmest surface.
Result<Target> find_target(const CoarseDepth& scene) {
  Target best;
  double lowest = INFINITY;
  for (int row = 0; row < scene.rows(); ++row) {
    for (int column = 0; column < scene.columns(); ++column) {
      const int end_column = std::min(column + 1, scene.columns() - 1);
      const double cost = scene.unevenness(column, row) + scene.unevenness(end_column, row);
      if (cost < lowest) lowest = cost, best = {column, row, end_column};
    }
  }
  if (std::isfinite(lowest)) return best;
  return Error{
      Errc::bad_input,
      "the frames show no usable surface near their centre to touch: check the depth unit, "
      "or give a tool path with --path"};
}

/// Rotation that takes the tool's -z axis to the unit vector d. Turns about the horizontal axis
/// that lies across both, so that the tool does not roll.
Quaternion pointing_along(const Vec3d& d) {
  const Quaternion half_turn = axis_angle({1, 0, 0}, kPi);  // -z to +z
  const Vec3d axis = cross(Vec3d{0, 0, 1}, d);
  if (norm(axis) < 1e-9) return half_turn;
  return normalized(axis_angle(axis, std::acos(std::clamp(d.z, -1.0, 1.0))) * half_turn);
}

/// Leans the end that is near the camera to the upper right of the image.
Quaternion held_like_a_pen(const Vec3d& ray) {
  const Vec3d upper_right{0.7, -0.7, 0};
  return normalized(axis_angle(cross(upper_right, ray), kLean) * pointing_along(ray));
}

/// The tool as a plane across the unit vector `along_T` meets it.
struct Imprint {
  double front = -INFINITY, back = INFINITY;  ///< m along `along_T`
  double press = 0;  ///< m, how far the front must go beyond the plane for kFraction of the volume
  Vec3d centre_T;    ///< of the part that is beyond the plane then, moved along `along_T` to 0
};

Imprint imprint(const Tool& tool, const Vec3d& along_T) {
  Imprint result;
  const auto along = [&](const Sphere& s) { return dot(to_double(s.centre), along_T); };
  for (const Sphere& s : tool.spheres()) {
    const double r = static_cast<double>(s.radius);
    result.front = std::max(result.front, along(s) + r);
    result.back = std::min(result.back, along(s) - r);
  }
  const auto beyond = [&](const Sphere& s, double depth) {
    return cap_volume(static_cast<double>(s.radius), result.front - depth - along(s));
  };
  double low = 0, high = result.front - result.back;
  for (int i = 0; i < 40; ++i) {
    result.press = (low + high) / 2;
    double volume = 0;
    for (const Sphere& s : tool.spheres()) volume += beyond(s, result.press);
    (volume < kFraction * tool.sphere_mass().volume ? low : high) = result.press;
  }
  double volume = 0;
  for (const Sphere& s : tool.spheres()) {
    const double part = beyond(s, result.press);
    result.centre_T += part * to_double(s.centre);
    volume += part;
  }
  if (volume > 0) result.centre_T = result.centre_T / volume;
  result.centre_T -= along_T * dot(result.centre_T, along_T);
  return result;
}

/// 0 before `start`, 1 after `end`, smooth in between.
double ease(double t, double start, double end) {
  const double x = std::clamp((t - start) / (end - start), 0.0, 1.0);
  return x * x * (3 - 2 * x);
}

}  // namespace

Result<std::vector<TimedPose>> probing_path(DepthSource& stream, const Tool& tool,
                                            std::optional<double> duration) {
  if (!duration && !stream.info().num_frames) {
    return Error{Errc::invalid_argument,
                 "the depth stream has no end: say how long the probing path is to be"};
  }
  if (duration && !(*duration > 0 && *duration * kPoseRate < 1e7)) {
    return Error{Errc::invalid_argument,
                 "a probing path must be longer than 0 s and shorter than a day"};
  }
  const auto scene =
      CoarseDepth::scan(stream, duration.value_or(std::numeric_limits<double>::infinity()));
  if (!scene) return scene.error();
  const double end = duration.value_or(scene->duration());
  const auto target = find_target(*scene);
  if (!target) return target.error();

  const Vec3d first_ray = scene->ray(target->column, target->row);
  const Vec3d last_ray = scene->ray(target->end_column, target->row);
  const DepthProfile first_depth = scene->profile(target->column, target->row);
  const DepthProfile last_depth = scene->profile(target->end_column, target->row);
  const Vec3d into_W = normalized(first_ray);
  const Quaternion held = held_like_a_pen(into_W);
  const Imprint tip = imprint(tool, rotate(conjugate(held), into_W));
  const double length = tip.front - tip.back;
  const double way = norm(last_ray - first_ray) * first_depth.at(end / 2);
  const double slide = way > 0 ? std::min(1.0, 0.3 * length / way) : 0;

  std::vector<TimedPose> path;
  const int num_steps = std::max(1, static_cast<int>(std::ceil(end * kPoseRate)));
  for (int i = 0; i <= num_steps; ++i) {
    const double share = static_cast<double>(i) / num_steps, time = share * end;
    const double pressed = ease(share, 0.05, 0.35) - ease(share, 0.75, 0.95);
    const double slid = ease(share, 0.4, 0.7);
    // The surface where the tool is now.
    const double shift = slide * slid;
    const double z = (1 - shift) * first_depth.at(time) + shift * last_depth.at(time);
    const Vec3d p_W = ((1 - shift) * first_ray + shift * last_ray) * z;
    // Free space is known between camera and surface only.
    const double stand_off = std::min(0.5 * length + 0.02, 0.5 * norm(p_W));
    const double depth = -stand_off + (stand_off + tip.press) * pressed;
    const Quaternion rotation = normalized(axis_angle(into_W, kMaxTurn * slid) * held);
    const Vec3d origin = p_W + into_W * (depth - tip.front) - rotate(rotation, tip.centre_T);
    path.push_back({time, {origin, rotation}});
  }
  return path;
}

}  // namespace palpate
