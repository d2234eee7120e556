// The words of simd.h for single numbers: for a CUDA thread, which is one lane of a wide machine.
// The same formulas then give the same bits on host and device.
#pragma once

#include <cmath>
#include <cstdint>
#include <cstring>

#include "palpate/core/core.h"

#if defined(PALPATE_LANES)
#error "files compiled by palpate_kernel have simd.h"
#endif
#define PALPATE_ISA_NAMESPACE one_lane

namespace palpate { inline namespace v0 { namespace one_lane {

using VecF = float;
using Mask = bool;

PALPATE_FORMULA VecF splat(float value) { return value; }
PALPATE_FORMULA VecF load(const float* from) { return *from; }

PALPATE_FORMULA VecF select(Mask mask, VecF a, VecF b) { return mask ? a : b; }
PALPATE_FORMULA bool is_any_set(Mask mask) { return mask; }
// For numbers, the device's own instructions say the same as these comparisons.
PALPATE_FORMULA VecF min(VecF a, VecF b) {
#if defined(__CUDA_ARCH__)
  return fminf(a, b);
#else
  return a < b ? a : b;
#endif
}
PALPATE_FORMULA VecF max(VecF a, VecF b) {
#if defined(__CUDA_ARCH__)
  return fmaxf(a, b);
#else
  return a > b ? a : b;
#endif
}
PALPATE_FORMULA VecF sqrt(VecF v) { return std::sqrt(v); }
PALPATE_FORMULA VecF abs(VecF v) { return std::fabs(v); }

PALPATE_FORMULA std::int32_t bits_of(VecF v) {
#if defined(__CUDA_ARCH__)
  return __float_as_int(v);
#else
  std::int32_t bits;
  std::memcpy(&bits, &v, sizeof bits);
  return bits;
#endif
}
PALPATE_FORMULA VecF from_bits(std::int32_t bits) {
#if defined(__CUDA_ARCH__)
  return __int_as_float(bits);
#else
  VecF v;
  std::memcpy(&v, &bits, sizeof v);
  return v;
#endif
}

}}}  // namespace palpate::v0::one_lane
