// The tangent plane of a point, as its pixel sees it. Shared code for CPU and GPU, for single
// points and vectors of them.
#pragma once

#include "palpate/core/core.h"

namespace palpate::inline v0 {

// Where there is no surface: so far in front that no sphere is near.
inline constexpr float kFreeOffset = 10.0f;

/// A pixel's tangent plane; no surface if the slope is 0.
struct alignas(8) TangentPlane {
  float offset = kFreeOffset, slope = 0;

  PALPATE_HOSTDEV bool is_surface() const { return slope > 0; }
};
static_assert(sizeof(TangentPlane) == 2 * sizeof(float));  // read as pairs of numbers

/// Of the points at depth z; none where z is not positive. Their planes pass the eye at the
/// distance -(p . n).
template <class Plane, class Real>
PALPATE_FORMULA Plane tangent_plane(Real x, Real y, Real z, Real nx, Real ny, Real nz) {
  // A surface seen so aslant that its plane passes the eye closer than this share of its depth
  // counts as steep as that.
  constexpr float kMinOffset = 0.02f;
  const Real d = -(x * nx + y * ny + z * nz), least = kMinOffset * z;
  const Real offset = d < least ? least : d;
  return {z > Real{} ? offset : Real{} + kFreeOffset, z > Real{} ? offset / z : Real{}};
}

}  // namespace palpate::inline v0
