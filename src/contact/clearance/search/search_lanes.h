// The vectors of a search: those of the processor in kernel files, the warps of a GPU in files that
// include warp_lanes.cuh before.
#pragma once

#if !defined(PALPATE_LANE_CODE)
#include "src/core/internal/simd.h"

#define PALPATE_LANE_CODE
#define PALPATE_LANE_INLINE [[gnu::always_inline]] inline

namespace palpate { inline namespace v0 { namespace PALPATE_ISA_NAMESPACE {

inline VecI select(Mask mask, VecI a, VecI b) { return mask ? a : b; }
inline float lane_of(VecF a, int lane) { return a[lane]; }
inline std::int32_t lane_of(VecI a, int lane) { return a[lane]; }
inline float root(float v) { return __builtin_sqrtf(v); }
inline int first_lane(std::uint32_t bits) { return __builtin_ctz(bits); }

/// Vector k of sixteen numbers.
inline VecF load_part(const float* from, int k) { return load(from + k * kLanes); }

/// table[index[i]] for each lane.
inline VecI pick(const std::int32_t (&table)[8], VecI index) {
#if PALPATE_LANES == 16
  const __m256i entries = _mm256_loadu_si256(reinterpret_cast<const __m256i*>(table));
  return reinterpret_cast<VecI>(
      _mm512_permutexvar_epi32(reinterpret_cast<__m512i>(index), _mm512_castsi256_si512(entries)));
#elif PALPATE_LANES == 8
  const __m256i entries = _mm256_loadu_si256(reinterpret_cast<const __m256i*>(table));
  return reinterpret_cast<VecI>(
      _mm256_permutevar8x32_epi32(entries, reinterpret_cast<__m256i>(index)));
#else
  return gather(table, index);
#endif
}

/// The least number of all lanes.
inline float min_lane(VecF v) {
#if PALPATE_LANES == 16
  return _mm512_reduce_min_ps(reinterpret_cast<__m512>(v));
#elif PALPATE_LANES == 8
  const __m256 w = reinterpret_cast<__m256>(v);
  const __m128 four = _mm_min_ps(_mm256_castps256_ps128(w), _mm256_extractf128_ps(w, 1));
  const __m128 two = _mm_min_ps(four, _mm_movehl_ps(four, four));
  return _mm_cvtss_f32(_mm_min_ss(two, _mm_shuffle_ps(two, two, 1)));
#else
  float least = v[0];
  for (int i = 1; i < kLanes; ++i) least = v[i] < least ? v[i] : least;
  return least;
#endif
}

}}}  // namespace palpate::v0::PALPATE_ISA_NAMESPACE
#endif

namespace palpate { inline namespace v0 { namespace PALPATE_ISA_NAMESPACE {

PALPATE_LANE_CODE inline float max_lane(VecF v) { return -min_lane(-v); }

}}}  // namespace palpate::v0::PALPATE_ISA_NAMESPACE
