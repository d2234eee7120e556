// The end of every query's kernel: sums of all threads, in an order independent of their timing,
// straight into the host's memory.
#pragma once

#include <cstdint>
#include <cstring>

#include "src/contact/cuda/query_answer.h"
#include "src/gpu/internal/team.cuh"

namespace palpate { inline namespace v0 {

/// The part of a block's shared memory that finish_measure needs, for so many sums.
template <int kNum>
struct FinishScratchOf {
  static constexpr int kMaxWarps = 32;

  double terms[kMaxWarps * kNum];
  int is_last;
};
using FinishScratch = FinishScratchOf<MeasureTerms::kNum>;
using FinishStiffnessScratch = FinishScratchOf<MeasureTerms::kNum + MeasureTerms::kNumStiffness>;

/// Folds 2 kHalf values over lanes: hands one half over to a lane that keeps that half, which adds
/// it to its own, and takes the other half in turn. Then again, with half of the half. Lanes are
/// kStride kHalf apart.
template <int kHalf, int kStride, int kNum>
__device__ inline void fold_over_warp(double (&values)[kNum]) {
  const bool keeps_upper = (gpu::lane_id() & kStride * kHalf) != 0;
#pragma unroll
  for (int i = 0; i < kHalf; ++i) {
    const double lower = values[i], upper = values[i + kHalf];
    const double given =
        __shfl_xor_sync(gpu::kWholeWarp, keeps_upper ? lower : upper, kStride * kHalf);
    values[i] = (keeps_upper ? upper : lower) + given;
  }
  if constexpr (kHalf > 1) fold_over_warp<kHalf / 2, kStride>(values);
}

/// Returns values[first] + values[first + step] + ... while the index is below `end`, which is not
/// before `first`. Eight loads at a time are in flight.
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

/// Writes the sums of this warp.
__device__ inline void put_terms(const MeasureTerms& mine, double* terms) {
  double values[MeasureTerms::kNum] = {mine.volume,
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
                                       mine.unseen,
                                       0,
                                       0};
  fold_over_warp<MeasureTerms::kNum / 2, 2>(values);
  const double of_warp = values[0] + __shfl_xor_sync(gpu::kWholeWarp, values[0], 1);
  if (gpu::lane_id() % 2 == 0) terms[gpu::lane_id() / 2] = of_warp;
}
/// Writes those of a stiffness behind them.
__device__ inline void put_terms(const float (&stiffness)[StiffnessSums::kNum], double* terms) {
  static_assert(MeasureTerms::kNumStiffness == gpu::kWarpSize);
  double values[MeasureTerms::kNumStiffness] = {};
#pragma unroll
  for (int k = 0; k < StiffnessSums::kNum; ++k) values[k] = stiffness[k];
  fold_over_warp<MeasureTerms::kNumStiffness / 2, 1>(values);
  terms[MeasureTerms::kNum + gpu::lane_id()] = values[0];
}

/// Writes two halves of a number, each with the number of the query above it.
__device__ inline void answer(const MeasureOutput& out, int number, double value) {
  std::uint64_t bits;
  memcpy(&bits, &value, sizeof bits);
  const std::uint64_t query = std::uint64_t{out.query} << 32;
  static_cast<volatile std::uint64_t*>(out.words)[2 * number] =
      query | static_cast<std::uint32_t>(bits);
  static_cast<volatile std::uint64_t*>(out.words)[2 * number + 1] = query | bits >> 32;
}

/// Adds the sums of each warp in shared.terms up to the answer, which is in the host's memory when
/// the last block is done. `num_threads`, at least kNum, add up blocks: their number sets the
/// order.
template <int kNum>
__device__ inline void finish_sums(const MeasureOutput& out, FinishScratchOf<kNum>& shared,
                                   unsigned num_threads) {
  const int thread = static_cast<int>(threadIdx.x);
  const auto num_terms = static_cast<unsigned>(gpu::warps_per_block() * kNum);
  __syncthreads();
  // Value k of this block, in thread k: warp by warp.
  double sum = thread < kNum ? sum_of_every(shared.terms, threadIdx.x, num_terms, kNum) : 0.0;
  if (gridDim.x > 1) {
    if (thread < kNum) out.partials[blockIdx.x * kNum + static_cast<unsigned>(thread)] = sum;
    if (!gpu::is_last_block(out.count, &shared.is_last)) return;
    // The partials of all blocks, some blocks at a time by as many threads as have whole ones.
    const unsigned num_groups = num_threads / kNum;
    const bool adds = threadIdx.x < num_groups * kNum;
    const double part =
        adds ? sum_of_every(out.partials, threadIdx.x, gridDim.x * kNum, num_groups * kNum) : 0.0;
    if (adds) shared.terms[threadIdx.x] = part;
    __syncthreads();
    if (thread < kNum) sum = sum_of_every(shared.terms, threadIdx.x, num_groups * kNum, kNum);
  }
  if (thread < kNum) answer(out, thread, sum);
}

/// Every thread of the grid calls this last, with its sums. The answer is in the host's memory when
/// the last block is done. `shared` is for this alone. `num_threads`: see finish_sums.
__device__ inline void finish_measure(const MeasureOutput& out, const MeasureTerms& mine,
                                      FinishScratch& shared, unsigned num_threads = blockDim.x) {
  put_terms(mine, shared.terms + gpu::warp_id() * MeasureTerms::kNum);
  finish_sums(out, shared, num_threads);
}

/// The same with the sums of a stiffness.
__device__ inline void finish_measure(const MeasureOutput& out, const MeasureTerms& mine,
                                      const float (&stiffness)[StiffnessSums::kNum],
                                      FinishStiffnessScratch& shared,
                                      unsigned num_threads = blockDim.x) {
  double* const terms = shared.terms + gpu::warp_id() * AnswerBox::kMaxNumbers;
  put_terms(mine, terms);
  put_terms(stiffness, terms);
  finish_sums(out, shared, num_threads);
}

}}  // namespace palpate::v0
