// The largest distance of points and spheres from a center: the radius of a tool about a point.
#pragma once

#include <algorithm>
#include <span>

#include "palpate/math/geometry.h"

namespace palpate { inline namespace v0 {

/// Returns the largest distance of a point from `center`, m; 0 without points.
inline double farthest(std::span<const Vec3d> points, const Vec3d& center) {
  double distance = 0;
  for (const Vec3d& p : points) distance = std::max(distance, norm(p - center));
  return distance;
}

/// Returns the largest distance of a point of a sphere from `center`, m, with radii multiplied by
/// `growth`; 0 without spheres.
inline double farthest(std::span<const Sphere> spheres, const Vec3d& center, double growth = 1) {
  double distance = 0;
  for (const Sphere& s : spheres) {
    distance = std::max(
        distance, norm(to_double(s.center) - center) + growth * static_cast<double>(s.radius));
  }
  return distance;
}

}}  // namespace palpate::v0
