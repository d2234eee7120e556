// The bilateral mean of a pixel's window (thesis eq. 3.12, divided by the sum of the weights).
// Shared code for vectors and for single numbers (lanes.h).
#pragma once

#include <cstddef>

#include "src/core/internal/lanes.h"

namespace palpate { inline namespace v0 { namespace PALPATE_ISA_NAMESPACE { namespace {

/// The mean is taken over differences to the center, which keeps all digits and a flat patch exact.
/// Invalid neighbors need no test: kNoDepth is so far off that their weight, 2^-100, times their
/// difference is nothing beside any depth.
PALPATE_FORMULA VecF filtered(const float* center, std::ptrdiff_t stride, VecF z, int radius,
                              const float* space, float range_scale) {
  const VecF squared = z * z;
  const VecF range = range_scale / (squared * squared);
  VecF sum = splat(0.0f), sum_weights = splat(1.0f);
  for (int dv = -radius; dv <= radius; ++dv) {
    const float* row = center + dv * stride;
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

}}}}  // namespace palpate::v0::PALPATE_ISA_NAMESPACE
