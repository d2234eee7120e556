// Formulas on VecF, Mask and the few functions that they have: compiled for vectors in kernel files
// (simd.h), for single numbers in CUDA code (one_lane.h).
#pragma once

#include "palpate/core/core.h"

#if defined(PALPATE_LANES)
#include "src/core/internal/simd.h"
#else
#include "src/core/one_lane.h"
#endif

namespace palpate { inline namespace v0 { namespace PALPATE_ISA_NAMESPACE {

/// 2^v for v <= 0, relative error below 2e-7; below -100 it stays at 2^-100, away from denormals.
PALPATE_FORMULA VecF exp2_negative(VecF v) {
  v = max(v, splat(-100.0f));
  // Adding 1.5 * 2^23 leaves the nearest whole number in the low bits.
  constexpr float kMagic = 12582912.0f;
  const VecF shifted = v + kMagic;
  const VecF f = v - (shifted - kMagic);  // -0.5 .. 0.5
  const VecF p =
      1.0f +
      f * (0.693147004f +
           f * (0.240222424f + f * (0.0555073358f + f * (0.00967151299f + f * 0.00132647285f))));
  return from_bits(bits_of(p) + (bits_of(shifted) << 23));
}

/// A power of two that brings a positive number near 1. Subtracting its bits from those of 2^127
/// inverts the exponent.
PALPATE_FORMULA VecF scale_to_unit(VecF v) { return from_bits(0x7f000000 - bits_of(abs(v))); }

}}}  // namespace palpate::v0::PALPATE_ISA_NAMESPACE
