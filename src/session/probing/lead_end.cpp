#include "src/session/probing/lead_end.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <iterator>
#include <vector>

#include "src/math/internal/jacobi.h"

namespace palpate { inline namespace v0 {
namespace {

constexpr double kFirstPart = 0.1;         // of the tool's length
constexpr double kAboutAsThin = 1.25;      // times the least volume: packings are not exact
constexpr double kStandsOut = 0.1;         // of the largest moment of inertia
constexpr double kNearlyParallel = 0.995;  // cosine: 6 degrees
constexpr double kNear = 0.1;  // of the tool's length: spheres do not reach into thin tips

struct Extent {
  double low = INFINITY, high = -INFINITY;
};

Extent extent_along(const Tool& tool, const Vec3d& axis_T) {
  Extent extent;
  for (const Sphere& s : tool.spheres()) {
    const double along = dot(to_double(s.center), axis_T), r = static_cast<double>(s.radius);
    extent.low = std::min(extent.low, along - r);
    extent.high = std::max(extent.high, along + r);
  }
  return extent;
}

/// Returns the spheres' volume in front of a plane `depth` behind the foremost point, m3.
double volume_of_end(const Tool& tool, const Vec3d& direction_T, double depth) {
  const double plane = extent_along(tool, direction_T).high - depth;
  double volume = 0;
  for (const Sphere& s : tool.spheres()) {
    volume +=
        cap_volume(static_cast<double>(s.radius), plane - dot(to_double(s.center), direction_T));
  }
  return volume;
}

/// Returns the foremost point of all spheres.
Vec3d foremost(const Tool& tool, const Vec3d& direction_T) {
  Vec3d best;
  double front = -INFINITY;
  for (const Sphere& s : tool.spheres()) {
    const Vec3d p = to_double(s.center) + direction_T * static_cast<double>(s.radius);
    if (dot(p, direction_T) > front) front = dot(p, direction_T), best = p;
  }
  // Rounded to a micrometer, so that 0 is printed as 0.
  for (int i = 0; i < 3; ++i) best[i] = std::round(best[i] * 1e6) / 1e6 + 0.0;
  return best;
}

struct PrincipalAxis {
  Vec3d direction_T;
  double moment;  // of inertia about it
};

/// Returns the principal axes; the moments of inertia about them ascend, unless they are the axes
/// of the frame.
std::array<PrincipalAxis, 3> principal_axes(const Tool& tool) {
  Mat3d inertia = tool.sphere_mass().inertia, axes;
  diagonalize_ascending(inertia.m, axes.m);
  std::array<PrincipalAxis, 3> all;
  for (int i = 0; i < 3; ++i) {
    all[static_cast<std::size_t>(i)] = {{axes.m[0][i], axes.m[1][i], axes.m[2][i]},
                                        inertia.m[i][i]};
  }
  return all;
}

/// The axes of the tool's frame, z first.
constexpr Vec3d kFrameAxes[] = {{0, 0, 1}, {1, 0, 0}, {0, 1, 0}};

/// Returns the frame axis that is nearly this one, else the axis with its largest part positive.
Vec3d tidied(const Vec3d& axis) {
  for (const Vec3d& frame_axis : kFrameAxes) {
    if (std::abs(dot(axis, frame_axis)) > kNearlyParallel) return frame_axis;
  }
  double largest = 0;
  for (int i = 0; i < 3; ++i) {
    if (std::abs(axis[i]) > std::abs(largest)) largest = axis[i];
  }
  return largest < 0 ? -axis : axis;
}

/// Returns both ends of the principal axes that stand out (a cube has none), then of kFrameAxes.
std::vector<Vec3d> candidates(const Tool& tool) {
  const std::array<PrincipalAxis, 3> principal = principal_axes(tool);
  const double largest = std::max({principal[0].moment, principal[1].moment, principal[2].moment});
  std::vector<Vec3d> axes;
  for (std::size_t i = 0; i < 3; ++i) {
    const double to_others =
        std::min(std::abs(principal[i].moment - principal[(i + 1) % 3].moment),
                 std::abs(principal[i].moment - principal[(i + 2) % 3].moment));
    if (to_others > kStandsOut * largest) axes.push_back(tidied(principal[i].direction_T));
  }
  axes.insert(axes.end(), std::begin(kFrameAxes), std::end(kFrameAxes));
  std::vector<Vec3d> ends;
  for (const Vec3d& axis : axes) ends.insert(ends.end(), {-axis, axis});
  return ends;
}

double length_of(const Tool& tool) {
  double length = 0;
  for (const Vec3d& axis : kFrameAxes) {
    const Extent extent = extent_along(tool, axis);
    length = std::max(length, extent.high - extent.low);
  }
  return length;
}

}  // namespace

LeadEnd thinnest_end(const Tool& tool) {
  const std::vector<Vec3d> ends = candidates(tool);
  const double depth = kFirstPart * length_of(tool);
  std::vector<double> volumes;
  for (const Vec3d& end : ends) volumes.push_back(volume_of_end(tool, end, depth));
  const double least = *std::min_element(volumes.begin(), volumes.end());
  const auto chosen = std::find_if(volumes.begin(), volumes.end(),
                                   [&](double volume) { return volume <= kAboutAsThin * least; });
  const Vec3d direction = ends[static_cast<std::size_t>(chosen - volumes.begin())];
  char why[120];
  std::snprintf(why, sizeof why, "the thinnest end: %.2g %% of the tool lie in its first %.3g mm",
                100 * *chosen / tool.sphere_mass().volume, 1000 * depth);
  return {direction, foremost(tool, direction), why};
}

Result<LeadEnd> end_at(const Tool& tool, const Vec3d& tip_T) {
  double distance = INFINITY;
  for (const Sphere& s : tool.spheres()) {
    distance =
        std::min(distance, norm(tip_T - to_double(s.center)) - static_cast<double>(s.radius));
  }
  char text[300];
  if (const double length = length_of(tool); !(distance <= kNear * length)) {
    const Extent x = extent_along(tool, {1, 0, 0}), y = extent_along(tool, {0, 1, 0}),
                 z = extent_along(tool, {0, 0, 1});
    std::snprintf(
        text, sizeof text,
        "the tip %g, %g, %g is %.3g m away from the tool, which reaches from %.3g, %.3g, "
        "%.3g to %.3g, %.3g, %.3g: give a point on it, in meters in the frame of its mesh",
        tip_T.x, tip_T.y, tip_T.z, distance, x.low, y.low, z.low, x.high, y.high, z.high);
    return Error{Errc::invalid_argument, text};
  }
  const Vec3d way = tip_T - tool.sphere_mass().center_of_mass;
  if (!(norm(way) > 1e-3 * length_of(tool))) {
    std::snprintf(text, sizeof text,
                  "the tip %g, %g, %g is the center of mass of the tool, which says nothing about "
                  "the end that leads: give a point on its surface",
                  tip_T.x, tip_T.y, tip_T.z);
    return Error{Errc::invalid_argument, text};
  }
  return LeadEnd{normalized(way), tip_T, "as you said"};
}

}}  // namespace palpate::v0
