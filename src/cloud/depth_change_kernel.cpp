// Where the surface ends towards something farther away (thesis section 3.5), compiled once per
// instruction set.
#include "src/cloud/surface_kernels.h"
#include "src/core/simd.h"

namespace palpate::PALPATE_ISA_NAMESPACE {
namespace {

// Depth, or 0 where there is none: never farther than anything.
inline VecF near_depth(const float* from) {
  const VecF z = load(from);
  return select(z < kAnyDepth, z, splat(0.0f));
}

inline VecF max_of_three(VecF a, VecF b, VecF c) { return max(max(a, b), c); }

}  // namespace

void find_depth_change(const DepthChangePass& pass, int row_begin, int row_end) {
  const VecF zero = splat(0.0f);
  const int width = pass.in.width;
  for (int v = row_begin; v < row_end; ++v) {
    const float* above = pass.in.row(v - 1);
    const float* here = pass.in.row(v);
    const float* below = pass.in.row(v + 1);
    const std::ptrdiff_t out = static_cast<std::ptrdiff_t>(v) * width;
    for (int u = 0; u < width; u += kLanes) {
      const VecF z = load(here + u);  // kNoDepth: nothing lies behind it
      const VecF a = near_depth(above + u - 1), b = near_depth(above + u),
                 c = near_depth(above + u + 1), d = near_depth(here + u - 1),
                 e = near_depth(here + u + 1), f = near_depth(below + u - 1),
                 g = near_depth(below + u), h = near_depth(below + u + 1);
      const VecF farthest = max(max_of_three(a, b, c), max(max(d, e), max_of_three(f, g, h)));
      const VecF limit = z + pass.min_step;
      VecF change[3] = {zero, zero, zero};
      if (mask_bits(farthest > limit) != 0) {
        const auto step = [&](VecF q) { return max(q - z - pass.min_step, zero); };
        const VecF corner_ac = step(c) - step(a), corner_fh = step(h) - step(f);
        const VecF x = corner_ac + corner_fh + (step(e) - step(d));
        const VecF y = (step(f) + step(h) + step(g)) - (step(a) + step(c) + step(b));
        // l - (l.v) v with v = ray / |ray|.
        const VecF ray_x = load(pass.ray_x + u), ray_y = splat(pass.ray_y[v]);
        const VecF along = (x * ray_x + y * ray_y) / (ray_x * ray_x + ray_y * ray_y + 1.0f);
        change[0] = x - along * ray_x;
        change[1] = y - along * ray_y;
        change[2] = zero - along;  // no -0
      }
      for (int axis = 0; axis < 3; ++axis) {
        store_first(pass.change[axis] + out + u, change[axis], width - u);
      }
    }
  }
}

}  // namespace palpate::PALPATE_ISA_NAMESPACE
