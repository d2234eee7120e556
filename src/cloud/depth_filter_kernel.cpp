// Bilateral filter of depth (thesis eq. 3.12, divided by the sum of the weights), compiled once per
// instruction set.
#include <algorithm>
#include <limits>

#include "src/cloud/surface_kernels.h"
#include "src/core/simd.h"

namespace palpate::PALPATE_ISA_NAMESPACE {
namespace {

// The mean is taken over differences to the centre, which keeps all digits and a flat patch exact.
// Invalid neighbours need no test: kNoDepth is so far off that their weight, 2^-100, times their
// difference is nothing beside any depth.
[[gnu::always_inline]] inline VecF filtered(const FilterPass& pass, const float* centre, VecF z,
                                            int radius) {
  const VecF squared = z * z;
  const VecF range = pass.range / (squared * squared);
  VecF sum = splat(0.0f), sum_weights = splat(1.0f);
  const float* space = pass.space;
  for (int dv = -radius; dv <= radius; ++dv) {
    const float* row = centre + dv * pass.in.stride;
    for (int du = -radius; du <= radius; ++du, ++space) {
      if (du == 0 && dv == 0) continue;
      const VecF difference = load(row + du) - z;
      const VecF weight = exp2_negative(*space - difference * difference * range);
      sum += weight * difference;
      sum_weights += weight;
    }
  }
  return z + sum / sum_weights;
}

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
        result = select(valid, filtered(pass, in + u, z, radius), z);
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
