// Distances of a point to what a camera has seen. Each pixel is a ray from the eye: free up to its
// depth, solid beyond it (up to solid_behind). So the solid of a square of pixels lies in the
// pyramid of their rays beyond the nearest depth, and its free space before the farthest one.
// Shared by host and device, for single numbers and vectors of them.
#pragma once

#include "palpate/core/core.h"

namespace palpate { inline namespace v0 {

/// Relative and absolute (m2) rounding of squared distances: bounds are lowered by these, so that
/// no square is passed over that has the nearest pixel.
inline constexpr float kBoundShare = 1e-3f, kBoundSlack = 1e-9f;

/// Vectors of warps have their own.
template <class Mask, class Real>
PALPATE_FORMULA Real choose(const Mask& mask, const Real& a, const Real& b) {
  return mask ? a : b;
}
template <class Real>
PALPATE_FORMULA Real lesser(const Real& a, const Real& b) {
  return choose(a < b, a, b);
}
template <class Real>
PALPATE_FORMULA Real greater(const Real& a, const Real& b) {
  return choose(a > b, a, b);
}

/// A point in the camera frame.
template <class Real>
struct CameraPoint {
  Real x, y, z;
};

/// The rays of a square of pixels, by the slopes x / z and y / z of the outermost ones.
template <class Real>
struct RaySquare {
  Real left, right, top, bottom;
};

/// Returns the squared distance to the part of a ray from depth `first` to `last`.
template <class Real>
PALPATE_FORMULA Real ray_distance2(const CameraPoint<Real>& p, const Real& x, const Real& y,
                                   const Real& first, const Real& last) {
  const Real one = Real{} + 1.0f;
  const Real along = (p.z + p.x * x + p.y * y) / (one + x * x + y * y);
  const Real t = lesser(greater(along, first), last);
  const Real dx = p.x - t * x, dy = p.y - t * y, dz = p.z - t;
  return dx * dx + dy * dy + dz * dz;
}

/// Returns the squared distance, seen along one of the axes of the image, to the rays from slope
/// `low` to `high` between two depths: no more than that to the square.
template <class Real>
PALPATE_FORMULA Real wedge_distance2(const Real& across, const Real& z, const Real& low,
                                     const Real& high, const Real& first, const Real& last) {
  const Real one = Real{} + 1.0f;
  const auto is_above = across > high * z, is_below = across < low * z;
  const Real edge = choose(is_above, high, low);
  const Real foot = (z + across * edge) / (one + edge * edge);
  const Real along = choose(is_above | is_below, foot, z);
  const Real t = lesser(greater(along, first), last);
  const Real beyond = greater(greater(across - t * high, t * low - across), Real{});
  const Real before = z - t;
  return before * before + beyond * beyond;
}

/// Returns a lower bound of the squared distance to everything on the rays of a square between two
/// depths.
template <class Real>
PALPATE_FORMULA Real square_bound2(const CameraPoint<Real>& p, const RaySquare<Real>& rays,
                                   const Real& first, const Real& last) {
  const Real bound = greater(wedge_distance2(p.x, p.z, rays.left, rays.right, first, last),
                             wedge_distance2(p.y, p.z, rays.top, rays.bottom, first, last));
  return bound - (kBoundShare * bound + kBoundSlack);
}

}}  // namespace palpate::v0
