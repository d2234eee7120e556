// Pixels at an edge that lie on neither of its surfaces. Shared code for vectors and for single
// numbers (lanes.h).
#pragma once

#include <cstddef>

#include "src/cloud/surface/surface_kernels.h"
#include "src/core/internal/lanes.h"

namespace palpate { inline namespace v0 { namespace PALPATE_ISA_NAMESPACE { namespace {

/// True if `z` lies between the depths of two opposite neighbors, farther than `gap` z from both.
/// False where a neighbor was not measured.
PALPATE_FORMULA Mask lies_between(const float* one, const float* other, VecF z, VecF gap) {
  const VecF a = load(one), b = load(other);
  const VecF nearer = min(a, b), farther = max(a, b);
  return (z - nearer > gap) & (farther - z > gap) & (farther < splat(kAnyDepth));
}

/// See SurfaceOptions::flying_pixel_gap.
PALPATE_FORMULA Mask is_flying(const float* here, std::ptrdiff_t stride, VecF z, float gap_share) {
  const VecF gap = gap_share * z;
  return lies_between(here - 1, here + 1, z, gap) |
         lies_between(here - stride, here + stride, z, gap) |
         lies_between(here - stride - 1, here + stride + 1, z, gap) |
         lies_between(here - stride + 1, here + stride - 1, z, gap);
}

}}}}  // namespace palpate::v0::PALPATE_ISA_NAMESPACE
