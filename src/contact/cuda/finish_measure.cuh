// The end of every query's kernel: sums of all threads, in an order that does not depend on when
// they come, straight into the host's memory.
#pragma once

#include <cstdint>
#include <cstring>

#include "src/contact/cuda/query_answer.h"
#include "src/gpu/team.cuh"

namespace palpate {

/// The part of a block's shared memory that finish_measure needs.
struct FinishScratch {
  static constexpr int kMaxWarps = 32;

  double terms[kMaxWarps * MeasureTerms::kNum];
  int is_last;
};

/// One half of 2 kHalf values of this lane is handed over to a lane that keeps that half, and added
/// to what it has of it; the same the other way round. Then again, with half of the half.
template <int kHalf>
__device__ inline void fold_over_warp(double (&values)[MeasureTerms::kNum]) {
  const bool keeps_upper = (gpu::lane_id() & 2 * kHalf) != 0;
#pragma unroll
  for (int i = 0; i < kHalf; ++i) {
    const double lower = values[i], upper = values[i + kHalf];
    const double given = __shfl_xor_sync(gpu::kWholeWarp, keeps_upper ? lower : upper, 2 * kHalf);
    values[i] = (keeps_upper ? upper : lower) + given;
  }
  if constexpr (kHalf > 1) fold_over_warp<kHalf / 2>(values);
}

/// values[first] + values[first + step] + ... while the index is below `end`, which is not before
/// `first`. Eight at a time are on their way.
__device__ inline double sum_of_every(const double* values, unsigned first, unsigned end,
                                      unsigned step) {
  constexpr unsigned kAtOnce = 8;
  double sum = 0;
  for (unsigned start = first; start < end; start += kAtOnce * step) {
    double got[kAtOnce];
#pragma unroll
    for (unsigned i = 0; i < kAtOnce; ++i) {
      const unsigned at = start + i * step;
      const double value = values[at < end ? at : first];
      got[i] = at < end ? value : 0.0;
    }
#pragma unroll
    for (unsigned i = 0; i < kAtOnce; ++i) sum += got[i];
  }
  return sum;
}

/// Every thread of the grid calls this last, with what it has found. The answer is in the host's
/// memory when the last block is done. `shared` is for this alone.
__device__ inline void finish_measure(const MeasureOutput& out, const MeasureTerms& mine,
                                      FinishScratch& shared) {
  constexpr int kNum = MeasureTerms::kNum;
  const int thread = static_cast<int>(threadIdx.x), lane = gpu::lane_id();
  const auto num_terms = static_cast<unsigned>(gpu::warps_per_block() * kNum);
  // Value k of this block, in thread k: each warp's by its lanes, then warp by warp.
  double values[kNum] = {mine.volume,
                         mine.potential,
                         mine.force[0],
                         mine.force[1],
                         mine.force[2],
                         mine.torque[0],
                         mine.torque[1],
                         mine.torque[2],
                         mine.num_boundary,
                         mine.num_inside,
                         mine.num_points,
                         mine.status,
                         mine.num_rounds,
                         0,
                         0,
                         0};
  // Of value k in lanes 2 k and 2 k + 1.
  fold_over_warp<kNum / 2>(values);
  const double of_warp = values[0] + __shfl_xor_sync(gpu::kWholeWarp, values[0], 1);
  if (lane % 2 == 0) shared.terms[gpu::warp_id() * kNum + lane / 2] = of_warp;
  __syncthreads();
  double sum = thread < kNum ? sum_of_every(shared.terms, threadIdx.x, num_terms, kNum) : 0.0;
  if (gridDim.x > 1) {
    if (thread < kNum) out.partials[blockIdx.x * kNum + static_cast<unsigned>(thread)] = sum;
    if (!gpu::is_last_block(out.count, &shared.is_last)) return;
    // The partials of all blocks, two blocks at a time by each warp.
    double part = sum_of_every(out.partials, threadIdx.x, gridDim.x * kNum, blockDim.x);
    part += __shfl_xor_sync(gpu::kWholeWarp, part, kNum);
    if (lane < kNum) shared.terms[gpu::warp_id() * kNum + lane] = part;
    __syncthreads();
    if (thread < kNum) sum = sum_of_every(shared.terms, threadIdx.x, num_terms, kNum);
  }
  if (gpu::warp_id() > 0) return;
  // Lanes 2 k and 2 k + 1 tell the halves of sum k. One store of 256 bytes.
  const double told = __shfl_sync(gpu::kWholeWarp, sum, lane / 2);
  std::uint64_t bits;
  memcpy(&bits, &told, sizeof bits);
  const std::uint32_t half = static_cast<std::uint32_t>(lane % 2 == 0 ? bits : bits >> 32);
  static_cast<volatile std::uint64_t*>(out.words)[lane] = std::uint64_t{out.query} << 32 | half;
}

}  // namespace palpate
