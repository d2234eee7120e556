// Directions along a surface.
#pragma once

#include <cmath>

#include "palpate/math/geometry.h"

namespace palpate { inline namespace v0 {

/// Returns a unit vector at right angles to the unit vector n, a function of n alone.
inline Vec3d first_tangent(const Vec3d& n) {
  const bool is_along_x = std::abs(n.x) > 0.7;
  return normalized(cross(n, is_along_x ? Vec3d{0, 1, 0} : Vec3d{1, 0, 0}));
}

/// Rotates a vector along the surface with its normal, the short way from `from` to `to`. Its
/// length stays. Returns zero if the normal turns over.
inline Vec3d rotated_along(const Vec3d& v, const Vec3d& from, const Vec3d& to) {
  const double cosine = dot(from, to);
  if (!(cosine > 0)) return {};
  return v - (from + to) * (dot(v, to) / (1 + cosine));
}

}}  // namespace palpate::v0
