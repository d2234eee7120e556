// The depth-change vector of a pixel (thesis section 3.5, eqs. 3.13-3.16 corrected). One text for
// vectors and for single numbers (lanes.h).
#pragma once

#include <cstddef>

#include "src/cloud/surface/surface_kernels.h"
#include "src/core/internal/lanes.h"

namespace palpate { inline namespace v0 { namespace PALPATE_ISA_NAMESPACE { namespace {

/// Returns the depth, or 0 where there is none: then it is not the farther one.
PALPATE_HOSTDEV inline VecF near_depth(const float* from) {
  const VecF z = load(from);
  return select(z < kAnyDepth, z, splat(0.0f));
}

PALPATE_HOSTDEV inline VecF max_of_three(VecF a, VecF b, VecF c) { return max(max(a, b), c); }

/// The eight neighbors of a pixel, row by row.
struct Around {
  VecF a, b, c, d, e, f, g, h;
};

PALPATE_FORMULA Around depths_around(const float* here, std::ptrdiff_t stride) {
  const float* const above = here - stride;
  const float* const below = here + stride;
  return {near_depth(above - 1), near_depth(above),    near_depth(above + 1),
          near_depth(here - 1),  near_depth(here + 1), near_depth(below - 1),
          near_depth(below),     near_depth(below + 1)};
}

PALPATE_FORMULA VecF farthest(const Around& q) {
  return max(max_of_three(q.a, q.b, q.c), max(max(q.d, q.e), max_of_three(q.f, q.g, q.h)));
}

struct DepthChange {
  VecF x, y, z;
};

PALPATE_FORMULA DepthChange depth_change(const Around& q, VecF z, VecF ray_x, VecF ray_y,
                                         float min_step) {
  const VecF zero = splat(0.0f);
  const VecF a = max(q.a - z - min_step, zero), b = max(q.b - z - min_step, zero),
             c = max(q.c - z - min_step, zero), d = max(q.d - z - min_step, zero),
             e = max(q.e - z - min_step, zero), f = max(q.f - z - min_step, zero),
             g = max(q.g - z - min_step, zero), h = max(q.h - z - min_step, zero);
  const VecF x = ((c - a) + (h - f)) + (e - d);
  const VecF y = (f + h + g) - (a + c + b);
  // l - (l.v) v with v = ray / |ray|.
  const VecF along = (x * ray_x + y * ray_y) / (ray_x * ray_x + ray_y * ray_y + 1.0f);
  return {x - along * ray_x, y - along * ray_y, zero - along};  // no -0
}

}}}}  // namespace palpate::v0::PALPATE_ISA_NAMESPACE
