#include "palpate/session/probing_path.h"

#include <algorithm>
#include <cmath>

#include "palpate/math/sphere.h"

namespace palpate {
namespace {

constexpr double kFraction = 0.1;  // of the tool's volume behind the surface at full depth
constexpr double kPoseRate = 100;  // poses per second
constexpr double kMaxTurn = 0.2;   // rad, about the viewing ray

/// Where the tool will touch.
struct Target {
  Vec3d p_W;    ///< on the surface
  Vec3d ray_W;  ///< unit, from the camera into the surface
};

/// A point of about the median depth of a central window, as near as possible to the image centre.
/// The window grows until it holds enough points.
Result<Target> find_target(const PointCloudView& cloud) {
  constexpr std::size_t kMinPoints = 50;
  const int u0 = cloud.width / 2, v0 = cloud.height / 2;
  for (const int divisor : {12, 6, 3, 2}) {
    const int half_width = cloud.width / divisor, half_height = cloud.height / divisor;
    std::vector<std::size_t> points;
    std::vector<float> depths;
    for (int v = std::max(0, v0 - half_height); v < std::min(cloud.height, v0 + half_height); ++v) {
      for (int u = std::max(0, u0 - half_width); u < std::min(cloud.width, u0 + half_width); ++u) {
        const std::size_t i = static_cast<std::size_t>(v) * static_cast<std::size_t>(cloud.width) +
                              static_cast<std::size_t>(u);
        if (!std::isfinite(cloud.z[i])) continue;
        points.push_back(i);
        depths.push_back(cloud.z[i]);
      }
    }
    if (points.size() < kMinPoints) continue;
    const auto middle = depths.begin() + static_cast<std::ptrdiff_t>(depths.size() / 2);
    std::nth_element(depths.begin(), middle, depths.end());
    const float median = *middle;
    const auto distance_to_centre = [&](std::size_t i) {
      const int u = static_cast<int>(i % static_cast<std::size_t>(cloud.width));
      const int v = static_cast<int>(i / static_cast<std::size_t>(cloud.width));
      return std::hypot(u - u0, v - v0);
    };
    std::size_t best = points.front();
    double best_distance = INFINITY;
    for (const std::size_t i : points) {
      if (std::abs(cloud.z[i] - median) > 0.02f * median) continue;
      const double distance = distance_to_centre(i);
      if (distance < best_distance) best = i, best_distance = distance;
    }
    const Vec3d p{cloud.x[best], cloud.y[best], cloud.z[best]};
    return Target{p, normalized(p)};
  }
  return Error{Errc::bad_input,
               "the first frame shows no usable surface near its centre to touch: check the depth "
               "unit, or give a tool path with --path"};
}

/// Rotation that takes the tool's -z axis to the unit vector d. Turns about the horizontal axis
/// that lies across both, so that the tool does not roll.
Quaternion pointing_along(const Vec3d& d) {
  const Quaternion half_turn = axis_angle({1, 0, 0}, kPi);  // -z to +z
  const Vec3d axis = cross(Vec3d{0, 0, 1}, d);
  if (norm(axis) < 1e-9) return half_turn;
  return normalized(axis_angle(axis, std::acos(std::clamp(d.z, -1.0, 1.0))) * half_turn);
}

/// Where the tool's spheres lie along its -z axis.
struct Extent {
  double front = -INFINITY, back = INFINITY;
};

Extent extent_along_pointing(const Tool& tool) {
  Extent extent;
  for (const Sphere& s : tool.spheres()) {
    const double along = -static_cast<double>(s.centre.z), r = s.radius;
    extent.front = std::max(extent.front, along + r);
    extent.back = std::min(extent.back, along - r);
  }
  return extent;
}

/// How far the front of the tool must move beyond a plane across its axis so that a given fraction
/// of its sphere volume is behind that plane.
double depth_for_fraction(const Tool& tool, const Extent& extent, double fraction) {
  double low = 0, high = extent.front - extent.back;
  for (int i = 0; i < 40; ++i) {
    const double depth = (low + high) / 2;
    double volume = 0;
    for (const Sphere& s : tool.spheres()) {
      const double in_front = extent.front - depth + static_cast<double>(s.centre.z);
      volume += cap_volume(static_cast<double>(s.radius), in_front);
    }
    (volume < fraction * tool.sphere_mass().volume ? low : high) = depth;
  }
  return (low + high) / 2;
}

/// 0 before `start`, 1 after `end`, smooth in between.
double ease(double t, double start, double end) {
  const double x = std::clamp((t - start) / (end - start), 0.0, 1.0);
  return x * x * (3 - 2 * x);
}

}  // namespace

Result<std::vector<TimedPose>> probing_path(const PointCloudView& cloud, const Tool& tool,
                                            double duration) {
  if (!(duration > 0) || !std::isfinite(duration) || duration * kPoseRate > 1e7) {
    return Error{Errc::invalid_argument, "the duration of a probing path must be longer than 0 s"};
  }
  const auto target = find_target(cloud);
  if (!target) return target.error();
  const Vec3d ray = target->ray_W;
  const Extent extent = extent_along_pointing(tool);
  const double length = extent.front - extent.back;
  const double press = depth_for_fraction(tool, extent, kFraction);
  // Free space is known between camera and surface only.
  const double stand_off = std::min(0.5 * length + 0.02, 0.5 * norm(target->p_W));
  const Vec3d side = normalized(cross(Vec3d{0, 1, 0}, ray));
  const double slide = std::min(0.3 * length, 0.05);
  const Quaternion pointing = pointing_along(ray);
  const Vec3d& centre_T = tool.sphere_mass().centre_of_mass;
  const Vec3d off_axis_T{centre_T.x, centre_T.y, 0};

  std::vector<TimedPose> path;
  const int num_steps = std::max(1, static_cast<int>(std::ceil(duration * kPoseRate)));
  for (int i = 0; i <= num_steps; ++i) {
    const double share = static_cast<double>(i) / num_steps;
    const double depth =
        -stand_off + (stand_off + press) * (ease(share, 0.05, 0.4) - ease(share, 0.75, 0.95));
    const double sideways = slide * ease(share, 0.45, 0.7);
    const Quaternion rotation =
        normalized(axis_angle(ray, kMaxTurn * ease(share, 0.45, 0.7)) * pointing);
    const Vec3d origin = target->p_W + ray * (depth - extent.front) + side * sideways;
    path.push_back({share * duration, {origin - rotate(rotation, off_axis_T), rotation}});
  }
  return path;
}

}  // namespace palpate
