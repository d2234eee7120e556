// Depth-change vectors at the edges of surfaces (thesis section 3.5), compiled once per instruction
// set.
#include "src/cloud/average/depth_change.h"
#include "src/cloud/surface/surface_kernels.h"
#include "src/core/internal/simd.h"

namespace palpate { inline namespace v0 { namespace PALPATE_ISA_NAMESPACE {

void find_depth_change(const DepthChangePass& pass, const PixelWindow& part) {
  const VecF zero = splat(0.0f);
  const int width = pass.in.width;
  for (int v = part.top; v < part.bottom; ++v) {
    const float* here = pass.in.row(v);
    const std::ptrdiff_t out = static_cast<std::ptrdiff_t>(v) * width;
    for (int u = part.left; u < part.right; u += kLanes) {
      const VecF z = load(here + u);  // kNoDepth: nothing lies behind it
      const Around around = depths_around(here + u, pass.in.stride);
      DepthChange change{zero, zero, zero};
      if (mask_bits(farthest(around) > z + pass.min_step) != 0) {
        change = depth_change(around, z, load(pass.ray_x + u), splat(pass.ray_y[v]), pass.min_step);
      }
      store_first(pass.change[0] + out + u, change.x, width - u);
      store_first(pass.change[1] + out + u, change.y, width - u);
      store_first(pass.change[2] + out + u, change.z, width - u);
    }
  }
}

}}}  // namespace palpate::v0::PALPATE_ISA_NAMESPACE
