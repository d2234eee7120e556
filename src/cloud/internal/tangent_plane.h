// The tangent plane of a point, as its pixel sees it. Shared code for CPU and GPU, for single
// points and vectors of them.
#pragma once

#include <cstddef>

#include "palpate/cloud/point_cloud.h"
#include "palpate/core/core.h"
#include "src/cloud/frames/raw_depth.h"

namespace palpate { inline namespace v0 {

// Offset of a pixel without surface, m: out of reach of any sphere.
inline constexpr float kFreeOffset = 10.0f;

/// A pixel's tangent plane; no surface if the slope is 0.
struct alignas(8) TangentPlane {
  float offset = kFreeOffset, slope = 0;

  PALPATE_HOSTDEV bool is_surface() const { return slope > 0; }
};
static_assert(sizeof(TangentPlane) == 2 * sizeof(float));  // read as pairs of numbers

/// Returns the tangent planes of points at depth z; none where z is not positive. The distance of a
/// plane from the eye is -(p . n).
template <class Plane, class Real>
PALPATE_FORMULA Plane tangent_plane(Real x, Real y, Real z, Real nx, Real ny, Real nz) {
  // A surface seen so aslant that its plane passes the eye closer than this share of its depth
  // counts as steep as that.
  constexpr float kMinOffset = 0.02f;
  const Real d = -(x * nx + y * ny + z * nz), least = kMinOffset * z;
  const Real offset = d < least ? least : d;
  return {z > Real{} ? offset : Real{} + kFreeOffset, z > Real{} ? offset / z : Real{}};
}

/// Returns the plane of a pixel. An infinite depth has no point: the ray is free up to `max_depth`,
/// m, and ends in a plane that faces the camera.
template <class Plane, class Real>
PALPATE_FORMULA Plane plane_or_far(const Plane& plane, Real depth, float max_depth) {
  const auto is_far = depth > kFarthest;
  return {is_far ? Real{} + max_depth : plane.offset, is_far ? Real{} + 1.0f : plane.slope};
}

/// The plane of point i.
PALPATE_HOSTDEV inline TangentPlane plane_of(const PointCloudView& cloud, std::ptrdiff_t i) {
  const auto plane = tangent_plane<TangentPlane>(cloud.x[i], cloud.y[i], cloud.z[i], cloud.nx[i],
                                                 cloud.ny[i], cloud.nz[i]);
  return cloud.depth == nullptr ? plane : plane_or_far(plane, cloud.depth[i], cloud.max_depth);
}

/// Depth that a pixel sees, m: of its point, or `max_depth` if it is free up to there. Not
/// positive: it sees nothing.
PALPATE_HOSTDEV inline float seen_depth(const PointCloudView& cloud, std::ptrdiff_t i) {
  return cloud.depth != nullptr && cloud.depth[i] > kFarthest ? cloud.max_depth : cloud.z[i];
}

}}  // namespace palpate::v0
