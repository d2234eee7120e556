// The vectors of simd.h with the threads of a warp as their lanes, so that a kernel text for
// vectors runs on a GPU, too. All lanes of a warp call together.
#pragma once

#include <cmath>
#include <cstdint>

#include "palpate/core/core.h"
#include "src/gpu/internal/team.cuh"

#define PALPATE_ISA_NAMESPACE isa_warp
#define PALPATE_LANE_CODE __device__
#define PALPATE_LANE_INLINE __device__ __forceinline__

namespace palpate { inline namespace v0 { namespace PALPATE_ISA_NAMESPACE {

inline constexpr int kLanes = gpu::kWarpSize;

/// This lane's number; masks are 0 or -1.
struct VecF {
  float v = 0;
};
struct VecI {
  std::int32_t v = 0;
};

PALPATE_HOSTDEV inline VecF splat(float value) { return {value}; }
PALPATE_HOSTDEV inline VecI splat(std::int32_t value) { return {value}; }
PALPATE_HOSTDEV inline VecI mask_of(bool is_set) { return {is_set ? -1 : 0}; }

#define PALPATE_LANE_OPERATOR(op)                                                  \
  PALPATE_HOSTDEV inline VecF operator op(VecF a, VecF b) { return {a.v op b.v}; } \
  PALPATE_HOSTDEV inline VecF operator op(VecF a, float b) { return {a.v op b}; }  \
  PALPATE_HOSTDEV inline VecF operator op(float a, VecF b) { return {a op b.v}; }
PALPATE_LANE_OPERATOR(+)
PALPATE_LANE_OPERATOR(-)
PALPATE_LANE_OPERATOR(*)
PALPATE_LANE_OPERATOR(/)
#undef PALPATE_LANE_OPERATOR
#define PALPATE_LANE_OPERATOR(op)                                                  \
  PALPATE_HOSTDEV inline VecI operator op(VecI a, VecI b) { return {a.v op b.v}; } \
  PALPATE_HOSTDEV inline VecI operator op(VecI a, std::int32_t b) { return {a.v op b}; }
PALPATE_LANE_OPERATOR(+)
PALPATE_LANE_OPERATOR(*)
PALPATE_LANE_OPERATOR(&)
PALPATE_LANE_OPERATOR(|)
PALPATE_LANE_OPERATOR(<<)
PALPATE_LANE_OPERATOR(>>)
#undef PALPATE_LANE_OPERATOR
#define PALPATE_LANE_OPERATOR(op)                                                         \
  PALPATE_HOSTDEV inline VecI operator op(VecF a, VecF b) { return mask_of(a.v op b.v); } \
  PALPATE_HOSTDEV inline VecI operator op(VecI a, VecI b) { return mask_of(a.v op b.v); }
PALPATE_LANE_OPERATOR(<)
PALPATE_LANE_OPERATOR(<=)
PALPATE_LANE_OPERATOR(>)
PALPATE_LANE_OPERATOR(>=)
PALPATE_LANE_OPERATOR(==)
PALPATE_LANE_OPERATOR(!=)
#undef PALPATE_LANE_OPERATOR
PALPATE_HOSTDEV inline VecF operator-(VecF a) { return {-a.v}; }
PALPATE_HOSTDEV inline VecI operator~(VecI a) { return {~a.v}; }
PALPATE_HOSTDEV inline VecI& operator|=(VecI& a, VecI b) { return a = a | b; }
PALPATE_HOSTDEV inline VecI& operator&=(VecI& a, VecI b) { return a = a & b; }

PALPATE_HOSTDEV inline VecF choose(VecI mask, VecF a, VecF b) { return mask.v != 0 ? a : b; }
PALPATE_HOSTDEV inline VecF select(VecI mask, VecF a, VecF b) { return mask.v != 0 ? a : b; }
PALPATE_HOSTDEV inline VecI select(VecI mask, VecI a, VecI b) { return mask.v != 0 ? a : b; }
PALPATE_HOSTDEV inline VecF min(VecF a, VecF b) { return a.v < b.v ? a : b; }
PALPATE_HOSTDEV inline VecF max(VecF a, VecF b) { return a.v > b.v ? a : b; }
PALPATE_HOSTDEV inline VecF abs(VecF a) { return {a.v < 0 ? -a.v : a.v}; }
PALPATE_HOSTDEV inline VecF sqrt(VecF a) { return {std::sqrt(a.v)}; }
PALPATE_HOSTDEV inline float root(float a) { return std::sqrt(a); }
PALPATE_HOSTDEV inline VecI to_int(VecF a) { return {static_cast<std::int32_t>(a.v)}; }
PALPATE_HOSTDEV inline VecF to_float(VecI a) { return {static_cast<float>(a.v)}; }

__device__ inline VecI bits_of(VecF a) { return {__float_as_int(a.v)}; }

__device__ inline VecI lane_ids() { return {gpu::lane_id()}; }
__device__ inline VecF load(const float* from) { return {from[gpu::lane_id()]}; }
__device__ inline VecI load(const std::int32_t* from) { return {from[gpu::lane_id()]}; }
/// Sixteen numbers, twice.
__device__ inline VecF load_part(const float* from, int) { return {from[gpu::lane_id() % 16]}; }
__device__ inline VecF gather(const float* table, VecI index) { return {table[index.v]}; }
__device__ inline VecI pick(const std::int32_t (&table)[8], VecI index) { return {table[index.v]}; }
__device__ inline std::uint32_t mask_bits(VecI mask) {
  return __ballot_sync(gpu::kWholeWarp, mask.v != 0);
}
__device__ inline bool is_any_set(VecI mask) { return __any_sync(gpu::kWholeWarp, mask.v != 0); }
/// The number of one lane.
__device__ inline float lane_of(VecF a, int lane) {
  return __shfl_sync(gpu::kWholeWarp, a.v, lane);
}
__device__ inline std::int32_t lane_of(VecI a, int lane) {
  return __shfl_sync(gpu::kWholeWarp, a.v, lane);
}
/// Whole numbers in the order of the floats that they stand for, NaN aside, and back.
PALPATE_HOSTDEV inline std::int32_t in_order(std::int32_t bits) {
  return bits ^ ((bits >> 31) & 0x7fffffff);
}
/// The least number of all lanes, none of which is NaN.
__device__ inline float min_lane(VecF a) {
  std::int32_t least = in_order(__float_as_int(a.v));
#if defined(__CUDA_ARCH__) && __CUDA_ARCH__ >= 800
  least = __reduce_min_sync(gpu::kWholeWarp, least);  // one instruction, of whole numbers only
#else
  for (int step = gpu::kWarpSize / 2; step > 0; step /= 2) {
    const std::int32_t other = __shfl_xor_sync(gpu::kWholeWarp, least, step);
    least = other < least ? other : least;
  }
#endif
  return __int_as_float(in_order(least));
}
/// Number of the first lane whose bit is set.
__device__ inline int first_lane(std::uint32_t bits) { return __ffs(static_cast<int>(bits)) - 1; }

}}}  // namespace palpate::v0::PALPATE_ISA_NAMESPACE
