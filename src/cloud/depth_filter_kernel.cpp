// Bilateral filter of depth (thesis eq. 3.12), compiled once per instruction set.
#include <limits>

#include "src/cloud/bilateral.h"
#include "src/cloud/surface_kernels.h"
#include "src/core/simd.h"

namespace palpate::PALPATE_ISA_NAMESPACE {
namespace {

[[gnu::always_inline]] inline void filter_rows(const FilterPass& pass, int row_begin, int row_end,
                                               int radius) {
  const VecF nan = splat(std::numeric_limits<float>::quiet_NaN());
  for (int v = row_begin; v < row_end; ++v) {
    const float* in = pass.in.row(v);
    float* out = pass.out + v * pass.in.stride;
    float* depth = pass.depth + static_cast<std::ptrdiff_t>(v) * pass.in.width;
    for (int u = 0; u < pass.in.width; u += kLanes) {
      const VecF z = load(in + u);
      const VecI valid = z < kAnyDepth;
      VecF result = z;
      if (radius > 0 && mask_bits(valid) != 0) {
        result =
            select(valid, filtered(in + u, pass.in.stride, z, radius, pass.space, pass.range), z);
      }
      store(out + u, result);  // lanes beyond the width are margin and stay kNoDepth
      store_first(depth + u, select(valid, result, nan), pass.in.width - u);
    }
  }
}

}  // namespace

void filter_depth(const FilterPass& pass, int row_begin, int row_end) {
  if (pass.radius == 2) {
    filter_rows(pass, row_begin, row_end, 2);  // the default, unrolled
  } else {
    filter_rows(pass, row_begin, row_end, pass.radius);
  }
}

}  // namespace palpate::PALPATE_ISA_NAMESPACE
