// Steps of the adaptive filter on a GPU for single cells, of arrays in its memory or in a block's
// shared one, and the noise of an image from the counts of its details.
#pragma once

#include <cstddef>
#include <cstdint>
#include <limits>

#include "src/cloud/surface/adaptive/noise_fit.h"
#include "src/cloud/surface/adaptive/scale_rules.h"
#include "src/cloud/surface/surface_kernels.cuh"
#include "src/gpu/internal/team.cuh"

namespace palpate { inline namespace v0 { namespace one_lane { namespace {

constexpr float kNotMeasured = std::numeric_limits<float>::quiet_NaN();
constexpr int kReach = 2;  // cells, of a prediction

/// Inverse depth of a raw pixel among others, 0: none.
__device__ inline float inverse_depth(const FilterJob& job, const float* at, int stride) {
  const float z = *at;
  const bool valid =
      z < kAnyDepth && !(job.flying_gap > 0 && is_flying(at, stride, z, job.flying_gap));
  return valid ? 1.0f / z : 0.0f;
}

/// The mean of the two by two cells from `above` on.
__device__ inline float wider_cell(const float* above, int stride, float tolerance) {
  const float* const below = above + stride;
  return joined_cells(above[0], above[1], below[0], below[1], tolerance);
}

/// Two cells of a row that are written at once.
struct alignas(2 * sizeof(float)) CellPair {
  float left, right;
};

/// Predicts the two by two cells of a cell of level `level`; `out`: the upper left one, even.
__device__ inline void predict_cells(const float* at, int stride, int level, float* out,
                                     int out_stride) {
  const float tolerance = scale_tolerance(level), mean = *at;
  float lower[2 * kReach + 1], upper[2 * kReach + 1];
#pragma unroll
  for (int i = 0; i < 2 * kReach + 1; ++i) {
    const float* const p = at + i - kReach;
    const Halves h = halves_of(p[-2 * stride], p[-stride], p[0], p[stride], p[2 * stride]);
    lower[i] = h.lower;
    upper[i] = h.upper;
  }
  const QuarterSlope across = quarter_slope(at[-1], mean, at[1], tolerance);
  const QuarterSlope down = quarter_slope(at[-stride], mean, at[stride], tolerance);
  const bool has_plane = (mean > 0) & across.is_known & down.is_known;
#pragma unroll
  for (int row = 0; row < 2; ++row) {
    const float* const halves = row == 0 ? lower : upper;
    const float center = row == 0 ? mean - down.change : mean + down.change;
    const Halves h = halves_of(halves[0], halves[1], halves[2], halves[3], halves[4]);
    *reinterpret_cast<CellPair*>(out + row * out_stride) = {
        predicted_cell(h.lower, center - across.change, mean, has_plane),
        predicted_cell(h.upper, center + across.change, mean, has_plane)};
  }
}

/// Energy of a cell's detail in variances of the noise, kUnknown where it has none.
constexpr float kUnknown = -1.0f;
__device__ inline float detail_energy(float mean, float predicted, const ScaleNoise& noise) {
  return mean > 0 && predicted > 0 ? energy_of(mean, predicted, noise) : kUnknown;
}
/// Energy of a cell's neighborhood beyond that of noise, from the energies of details.
__device__ inline float own_energy(const float* at, int stride, float mean,
                                   const ScaleNoise& noise) {
  float sums[3], weights[3];  // of columns
#pragma unroll
  for (int column = 0; column < 3; ++column) {
    sums[column] = weights[column] = 0;
#pragma unroll
    for (int row = -1; row <= 1; ++row) {
      const float energy = at[row * stride + column - 1], share = row == 0 ? 2.0f : 1.0f;
      if (!(energy >= 0)) continue;
      sums[column] += share * energy;
      weights[column] += share;
    }
  }
  return excess_of(sums[0] + 2.0f * sums[1] + sums[2], weights[0] + 2.0f * weights[1] + weights[2],
                   mean, noise);
}
/// Energy of a cell with that of its finer ones, from `above` on.
__device__ inline float with_finer(float own, const float* above, int stride) {
  const float* const below = above + stride;
  return max(own, max(max(above[0], above[1]), max(below[0], below[1])));
}

/// The smoothed value of a cell. `wider`: its prediction from smoothed cells.
__device__ inline float smoothed_at(int level, const float* mean, const float* predicted,
                                    int stride, float wider, float energy,
                                    const ScaleNoise& noise) {
  float detail = *mean - *predicted;
  if (level < kCalmLevels && is_kept(*mean, *predicted, energy)) {
    detail = calm_detail(level, mean, predicted, stride, noise);
  }
  return smoothed_cell(*mean, detail, *predicted, wider, energy, noise);
}

// --- Noise -------------------------------------------------------------------------------------

constexpr int kDepths = DetailCounts::kDepths, kSizes = DetailCounts::kSizes;
constexpr int kNumRows = kNumScales * kDepths;  // of counts: one for each level and depth
constexpr int kNumCounts = kNumRows * kSizes;
static_assert(kDepths <= gpu::kWarpSize && kSizes % gpu::kWarpSize == 0);

/// Number of the count of a detail; -1: there is none.
__device__ inline int count_of(int level, float mean, float predicted) {
  if (!(mean > 0 && predicted > 0)) return -1;
  const DetailPlace place = place_of(mean, mean - predicted);
  return (level * kDepths + place.depth) * kSizes + place.size;
}

/// Counts of 32 bits.
struct WideCounts {
  std::uint32_t* words;

  __device__ void add(int at, unsigned num) const { atomicAdd(words + at, std::uint32_t{num}); }
  __device__ unsigned get(int at) const { return gpu::read_now(words + at); }
};
/// Counts of 16 bits, two in a word: for images of less than a million pixels.
struct PackedCounts {
  static constexpr int kNumWords = kNumCounts / 2;
  std::uint32_t* words;

  __device__ void add(int at, unsigned num) const {
    atomicAdd(words + at / 2, std::uint32_t{num << 16 * (at % 2)});
  }
  __device__ unsigned get(int at) const { return words[at / 2] >> 16 * (at % 2) & 0xffff; }
};

/// Counts what the lanes of a warp have found; all call. What most of them have found is one step.
template <class Counts>
__device__ void count_in_warp(const Counts& counts, int found) {
  const unsigned any = __ballot_sync(gpu::kWholeWarp, found >= 0);
  if (any == 0) return;
  const int leader = __ffs(static_cast<int>(any)) - 1;
  const int first = __shfl_sync(gpu::kWholeWarp, found, leader);
  const unsigned same = __ballot_sync(gpu::kWholeWarp, found == first);
  if (gpu::lane_id() == leader) {
    counts.add(first, static_cast<unsigned>(__popc(same)));
  } else if (found >= 0 && found != first) {
    counts.add(found, 1);
  }
}

/// Numbers on the way from the counts of an image to its noise, shared by a block.
struct NoiseShared {
  DetailNoise by_depth[kNumScales][kDepths];
  double terms[NoiseCurve::kNumSums][kDepths], sums[NoiseCurve::kNumSums];
  ScaleNoise noise[kNumScales];
};

/// Finds the noise of the details of a depth, row `row` of the counts. All lanes of a warp call.
template <class Counts>
__device__ void find_depth_noise(const Counts& counts, int row, NoiseShared& shared) {
  constexpr int kOwn = kSizes / gpu::kWarpSize;
  const int lane = gpu::lane_id();
  unsigned own[kOwn], sum = 0;
#pragma unroll
  for (int k = 0; k < kOwn; ++k) sum += own[k] = counts.get(row * kSizes + lane * kOwn + k);
  unsigned to_here = sum;  // with the lanes before
  for (int step = 1; step < gpu::kWarpSize; step *= 2) {
    const unsigned before = __shfl_up_sync(gpu::kWholeWarp, to_here, static_cast<unsigned>(step));
    if (lane >= step) to_here += before;
  }
  const unsigned num = __shfl_sync(gpu::kWholeWarp, to_here, gpu::kWarpSize - 1);
  DetailNoise& noise = shared.by_depth[row / kDepths][row % kDepths];
  if (num < static_cast<unsigned>(kMinDetails)) {
    if (lane == 0) noise = {};
    return;
  }
  const double quantile = kQuantile * num;
  if (!(to_here - sum < quantile && to_here >= quantile)) return;
  unsigned before = to_here - sum;
  for (int k = 0; k < kOwn; ++k) {
    if (before + own[k] >= quantile) {
      noise = quantile_noise(row % kDepths, num, lane * kOwn + k, before, own[k]);
      return;
    }
    before += own[k];
  }
}

/// Fits the noise of all levels to that by depth, as noise_of does: a lane has a depth, and sums
/// have the order of depths. All lanes of a warp call.
__device__ inline void fit_noise(NoiseShared& shared) {
  const int lane = gpu::lane_id();
  ScaleNoise before;
  double most = 0;
  for (int level = 0; level < kNumScales; ++level) {
    const DetailNoise at = lane < kDepths ? shared.by_depth[level][lane] : DetailNoise{};
    const unsigned known = __ballot_sync(gpu::kWholeWarp, at.sd >= 0);
    if (at.sd >= 0) {
      const double sd = limited_noise(at, level, shared.noise, most);
      if (most < sd) most = sd;
      const NoiseCurve terms = NoiseCurve::of(at.z, sd, at.num);
#pragma unroll
      for (int k = 0; k < NoiseCurve::kNumSums; ++k) shared.terms[k][lane] = terms.sums[k];
    }
    __syncwarp();
    if (lane < NoiseCurve::kNumSums) {
      double sum = 0;
      for (unsigned left = known; left != 0; left &= left - 1) {
        sum += shared.terms[lane][__ffs(static_cast<int>(left)) - 1];
      }
      shared.sums[lane] = sum;
    }
    __syncwarp();
    NoiseCurve curve;
#pragma unroll
    for (int k = 0; k < NoiseCurve::kNumSums; ++k) curve.sums[k] = shared.sums[k];
    const double own = curve.quotient(lane % NoiseCurve::kNumQuotients);
    double quotients[NoiseCurve::kNumQuotients];
#pragma unroll
    for (int k = 0; k < NoiseCurve::kNumQuotients; ++k) {
      quotients[k] = __shfl_sync(gpu::kWholeWarp, own, k);
    }
    if (!curve.is_empty()) before = curve.fitted(quotients);
    if (lane == 0) shared.noise[level] = before;
    __syncwarp();
  }
}

}}}}  // namespace palpate::v0::one_lane
