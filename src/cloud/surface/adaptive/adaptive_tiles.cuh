// The adaptive filter of large images: a block of a kernel does a tile of an image, one cell of the
// widest level.
#pragma once

#include <cstddef>
#include <cstdint>

#include "src/cloud/frames/far_pixels.cuh"
#include "src/cloud/surface/adaptive/adaptive_cells.cuh"
#include "src/cloud/surface/adaptive/adaptive_cuda.h"

namespace palpate { inline namespace v0 { namespace one_lane { namespace {

constexpr int kTileSide = 1 << kNumScales;  // pixels
static_assert(kTileSide == kTileWidth);
constexpr int kAdaptiveThreads = 512, kAdaptiveWarps = kAdaptiveThreads / gpu::kWarpSize;
constexpr int kAdaptiveBlocks = 3;   // at a time on a multiprocessor
constexpr int kMargin = 2 * kReach;  // cells, of a level

/// Number of the first cell of a level among those of a tile, which are counted level by level.
PALPATE_HOSTDEV constexpr int first_cell(int level) {
  return 4 * (kTileSide * kTileSide - (kTileSide * kTileSide >> 2 * level)) / 3;
}
constexpr int kTileCells = first_cell(kNumScales + 1);

/// Position of a block, and of the cells of its tile.
struct ScaleTile {
  int image, column, row;

  __device__ explicit ScaleTile(const AdaptiveJob& job) {
    const LevelCuda& widest = job.levels[kNumScales];
    const int num = job.num_tiles(), block = static_cast<int>(blockIdx.x);
    image = block / num;
    row = (block - image * num) / widest.width;
    column = block - image * num - row * widest.width;
  }
  __device__ int u(int level) const { return column * (kTileSide >> level); }
  __device__ int v(int level) const { return row * (kTileSide >> level); }
};

struct BeginShared {
  static constexpr int kStride = kTileSide + 2;

  int num_valid;
  float depths[kStride * kStride];
  float cells[kTileCells];
};

/// Reads the raw frame; makes level 0 of it, and all wider ones.
__global__ void __launch_bounds__(kAdaptiveThreads, kAdaptiveBlocks)
    begin_scales(const __grid_constant__ FilterJob filter,
                 const __grid_constant__ AdaptiveJob job) {
  BeginShared& shared = gpu::shared_memory<BeginShared>();
  constexpr int stride = BeginShared::kStride;
  const ScaleTile tile(job);
  const int thread = static_cast<int>(threadIdx.x), lane = gpu::lane_id();
  const LevelCuda& finest = job.levels[0];
  const int first_u = tile.u(0), first_v = tile.v(0);
  const auto depth_at = [&](int u, int v) {
    const bool is_inside = u >= 0 && v >= 0 && u < finest.width && v < finest.height;
    return is_inside ? raw_depth(filter, tile.image, u, v) : kNoDepth;
  };
  if (thread == 0) shared.num_valid = 0;
  float* const depths = shared.depths + stride + 1;
  int num_valid = 0;
#pragma unroll
  for (int k = 0; k < kTileSide / kAdaptiveWarps; ++k) {
    const int y = gpu::warp_id() + k * kAdaptiveWarps, v = first_v + y;
    const float z = depth_at(first_u + lane, v);
    const unsigned far = __ballot_sync(gpu::kWholeWarp, z > kNoDepth);
    if (lane == 0 && v < finest.height) {
      filter.far[filter.tiling.word(tile.image, v, tile.column)] = far;
    }
    num_valid += z < kAnyDepth;
    depths[y * stride + lane] = z;
  }
  if (filter.flying_gap > 0 && thread < 4 * (kTileSide + 1)) {  // around
    const int side = thread / (kTileSide + 1), along = thread % (kTileSide + 1);
    const int x = side == 0 ? along - 1 : side == 1 ? kTileSide : side == 2 ? along : -1;
    const int y = side == 0 ? -1 : side == 1 ? along - 1 : side == 2 ? kTileSide : along;
    depths[y * stride + x] = depth_at(first_u + x, first_v + y);
  }
  __syncthreads();
  num_valid = gpu::warp_sum(num_valid);
  if (lane == 0) atomicAdd(&shared.num_valid, num_valid);

  float* const means = job.mean + tile.image * job.cells_apart;
#pragma unroll
  for (int k = 0; k < kTileSide / kAdaptiveWarps; ++k) {
    const int y = gpu::warp_id() + k * kAdaptiveWarps;
    const float mean = inverse_depth(filter, depths + y * stride + lane, stride);
    shared.cells[y * kTileSide + lane] = mean;
    const int u = first_u + lane, v = first_v + y;
    if (u < finest.width && v < finest.height) means[finest.at(u, v)] = mean;
  }
#pragma unroll
  for (int number = 1; number <= kNumScales; ++number) {
    __syncthreads();
    const int side = kTileSide >> number;
    const LevelCuda& level = job.levels[number];
    if (thread >= side * side) continue;
    const int x = thread % side, y = thread / side;
    const float* const finer = shared.cells + first_cell(number - 1);
    const float mean =
        wider_cell(finer + 2 * (y * 2 * side + x), 2 * side, scale_tolerance(number));
    shared.cells[first_cell(number) + thread] = mean;
    const int u = tile.u(number) + x, v = tile.v(number) + y;
    if (u < level.width && v < level.height) means[level.at(u, v)] = mean;
  }
  if (thread == 0 && tile.image == 0) {
    filter.num_valid[2 * tile.row * filter.tiling.tiles_per_row + tile.column] = shared.num_valid;
  }
}

constexpr int kPredictThreads = 384, kPredictWarps = kPredictThreads / gpu::kWarpSize;
static_assert(kTileCells - first_cell(1) <= kPredictThreads && kNumRows <= kPredictThreads);

struct PredictShared {
  std::uint32_t seen[kNumScales];
  int is_last;
  NoiseShared noise;
};

/// Finds the free pixels of a tile of a strip, for the smoothed image.
__device__ inline void find_free(const FilterJob& filter, const AdaptiveJob& job, int block) {
  FarShared& shared = gpu::shared_memory<FarShared>();
  const Tile tile(filter.tiling, block);
  const bool is_any = find_free(filter, tile, shared);
  const int row = static_cast<int>(threadIdx.x), v = tile.v0 + row;
  if (row >= kStripRows || v >= filter.tiling.height) return;
  job.free[filter.tiling.word(tile.image, v, tile.u0 / kTileWidth)] = is_any ? shared.free[row] : 0;
}

/// Predicts all levels from the next wider ones and counts the details. The last block of an image
/// finds its noise. Blocks behind those of all tiles find the free pixels of the raw image.
__global__ void __launch_bounds__(kPredictThreads, kAdaptiveBlocks)
    predict_scales(const __grid_constant__ FilterJob filter,
                   const __grid_constant__ AdaptiveJob job, const int num_images) {
  const int behind = static_cast<int>(blockIdx.x) - num_images * job.num_tiles();
  if (behind >= 0) return find_free(filter, job, behind);
  PredictShared& shared = gpu::shared_memory<PredictShared>();
  const ScaleTile tile(job);
  const int thread = static_cast<int>(threadIdx.x), lane = gpu::lane_id();
  const float* const means = job.mean + tile.image * job.cells_apart;
  float* const predictions = job.predicted + tile.image * job.cells_apart;
  const WideCounts counts{job.counts + static_cast<std::ptrdiff_t>(tile.image) * kNumCounts};
  std::uint32_t* const all_seen = job.seen + tile.image * kNumScales;
  if (thread < kNumScales) shared.seen[thread] = 0;
  __syncthreads();
  const auto count = [&](int number, int at) {
    const int found = at >= 0 ? count_of(number, means[at], predictions[at]) : -1;
    count_in_warp(counts, found);
    if (found < 0) return;
    const int row = found / kSizes, level = row / kDepths;
    const std::uint32_t bit = 1u << (row - level * kDepths);
    if ((gpu::read_now(shared.seen + level) & bit) == 0) atomicOr(shared.seen + level, bit);
  };
  const int cell = first_cell(1) + thread;
  int wider = 1;
  while (wider < kNumScales && cell >= first_cell(wider + 1)) ++wider;
  const int number = wider - 1, shift = kNumScales - wider, rest = cell - first_cell(wider);
  const int u = tile.u(wider) + (rest & ((1 << shift) - 1)), v = tile.v(wider) + (rest >> shift);
  const LevelCuda &coarse = job.levels[wider], &fine = job.levels[number];
  const bool is_inside = cell < kTileCells && u < coarse.width && v < coarse.height;
  const int at = fine.at(2 * u, 2 * v);
  if (is_inside) {
    predict_cells(means + coarse.at(u, v), coarse.stride, wider, predictions + at, fine.stride);
  }
  const int step = count_step(number);  // 4, 2 or 1
  count(number, is_inside && (step < 4 || (u % 2 == 0 && v % 2 == 0)) ? at : -1);
  for (const int next : {1, fine.stride, fine.stride + 1}) {
    count(number, is_inside && step == 1 ? at + next : -1);
  }
  __syncthreads();
  if (thread < kNumScales && (shared.seen[thread] & ~gpu::read_now(all_seen + thread)) != 0) {
    atomicOr(all_seen + thread, shared.seen[thread]);
  }
  const auto num_tiles = static_cast<unsigned>(job.num_tiles());
  if (!gpu::is_last_block(job.num_done + tile.image, &shared.is_last, num_tiles)) return;

  if (thread < kNumScales) {
    shared.seen[thread] = gpu::read_now(all_seen + thread);
    all_seen[thread] = 0;  // for the next image
  }
  if (thread < kNumRows) shared.noise.by_depth[thread / kDepths][thread % kDepths] = {};
  __syncthreads();
  // The rows that have counts, by turns.
  int turn = gpu::warp_id();
  for (int level = 0; level < kNumScales; ++level) {
    for (unsigned left = shared.seen[level]; left != 0; left &= left - 1) {
      if (turn-- != 0) continue;
      turn = kPredictWarps - 1;
      const int row = level * kDepths + __ffs(static_cast<int>(left)) - 1;
      find_depth_noise(counts, row, shared.noise);
      for (int i = lane; i < kSizes; i += gpu::kWarpSize) counts.words[row * kSizes + i] = 0;
    }
  }
  __syncthreads();
  if (gpu::warp_id() != 0) return;
  fit_noise(shared.noise);
  if (lane < kNumScales) job.noise[tile.image * kNumScales + lane] = shared.noise.noise[lane];
  if (lane == 0 && job.frame_noise != nullptr) {
    job.frame_noise[tile.image] = frame_noise_of(shared.noise.noise);
  }
}

/// Cells of a tile's level with those around it.
PALPATE_HOSTDEV constexpr int wide_side(int level) { return (kTileSide >> level) + 2; }
PALPATE_HOSTDEV constexpr int first_wide_cell(int level) {
  return level == 0 ? 0 : first_wide_cell(level - 1) + wide_side(level - 1) * wide_side(level - 1);
}
struct EnergyShared {
  float details[first_wide_cell(kNumScales)];
  float cells[first_cell(kNumScales)];
};

/// The energy of all levels, with that of the finer and the wider ones.
__global__ void __launch_bounds__(kAdaptiveThreads, kAdaptiveBlocks)
    find_energies(const __grid_constant__ AdaptiveJob job) {
  EnergyShared& shared = gpu::shared_memory<EnergyShared>();
  const ScaleTile tile(job);
  const int thread = static_cast<int>(threadIdx.x);
  const std::ptrdiff_t image = tile.image * job.cells_apart;
  const ScaleNoise* const noise = job.noise + tile.image * kNumScales;
#pragma unroll
  for (int number = 0; number < kNumScales; ++number) {
    const LevelCuda& level = job.levels[number];
    const int side = wide_side(number);
    for (int i = thread; i < side * side; i += kAdaptiveThreads) {
      const int u = tile.u(number) + i % side - 1, v = tile.v(number) + i / side - 1;
      const bool is_near = u <= level.width && v <= level.height;
      const std::ptrdiff_t at = image + level.at(u, v);
      shared.details[first_wide_cell(number) + i] =
          is_near ? detail_energy(job.mean[at], job.predicted[at], noise[number]) : kUnknown;
    }
  }
  __syncthreads();
#pragma unroll
  for (int number = 0; number < kNumScales; ++number) {
    const LevelCuda& level = job.levels[number];
    const int side = kTileSide >> number;
    for (int i = thread; i < side * side; i += kAdaptiveThreads) {
      const int x = i % side, y = i / side, u = tile.u(number) + x, v = tile.v(number) + y;
      const bool is_inside = u < level.width && v < level.height;
      const float* const detail =
          shared.details + first_wide_cell(number) + (y + 1) * (side + 2) + x + 1;
      shared.cells[first_cell(number) + i] =
          is_inside ? own_energy(detail, side + 2, job.mean[image + level.at(u, v)], noise[number])
                    : 0.0f;
    }
  }
#pragma unroll
  for (int number = 1; number < kNumScales; ++number) {
    __syncthreads();
    const int side = kTileSide >> number;
    if (thread >= side * side) continue;
    float& cell = shared.cells[first_cell(number) + thread];
    const float* const finer = shared.cells + first_cell(number - 1);
    cell = with_finer(cell, finer + 2 * (thread / side * 2 * side + thread % side), 2 * side);
  }
#pragma unroll
  for (int number = kNumScales - 1; number >= 0; --number) {
    __syncthreads();
    const LevelCuda& level = job.levels[number];
    const int side = kTileSide >> number;
    for (int i = thread; i < side * side; i += kAdaptiveThreads) {
      const int x = i % side, y = i / side, u = tile.u(number) + x, v = tile.v(number) + y;
      float& cell = shared.cells[first_cell(number) + i];
      if (number < kNumScales - 1) {
        cell = max(cell,
                   kFinerShare * shared.cells[first_cell(number + 1) + y / 2 * (side / 2) + x / 2]);
      }
      if (u < level.width && v < level.height) job.energy[image + level.at(u, v)] = cell;
    }
  }
}

/// Cells around a tile that its smoothing needs of a level, each way: an even number.
PALPATE_HOSTDEV constexpr int reach_at(int level) {
  return level == 0 ? 0 : level == 1 ? kReach : 2 * kReach;
}
PALPATE_HOSTDEV constexpr int smoothed_side(int level) {
  return (kTileSide >> level) + 2 * reach_at(level);
}

/// The pixels of a tile and those around it, and its smoothed cells and those around them, of the
/// level that is made and of the wider one.
struct SmoothShared {
  static constexpr int kStride = kTileSide + 2 * kReach;

  alignas(16) float cells[2][smoothed_side(0) * smoothed_side(0)];
  float mean[kStride * kStride], predicted[kStride * kStride];
  int num_kept;
  std::uint16_t kept[smoothed_side(0) * smoothed_side(0)];
};
static_assert(smoothed_side(1) < smoothed_side(0));

/// Smooths all levels, from the widest on. What tiles need of their neighbors, they make, too.
/// Cells whose details are kept are put on a list, so that full warps take the means around them.
__global__ void __launch_bounds__(kAdaptiveThreads, kAdaptiveBlocks)
    smooth_scales(const __grid_constant__ FilterJob filter,
                  const __grid_constant__ AdaptiveJob job) {
  SmoothShared& shared = gpu::shared_memory<SmoothShared>();
  const ScaleTile tile(job);
  const int thread = static_cast<int>(threadIdx.x);
  const std::ptrdiff_t first = tile.image * job.cells_apart;
  const float* const means = job.mean + first;
  const float* const predictions = job.predicted + first;
  float* const depth = filter.depth + tile.image * filter.tiling.points_apart;

  constexpr int widest_side = smoothed_side(kNumScales), widest_reach = reach_at(kNumScales);
  if (thread < widest_side * widest_side) {
    const int u = tile.column - widest_reach + thread % widest_side;
    const int v = tile.row - widest_reach + thread / widest_side;
    shared.cells[kNumScales % 2][thread] = means[job.levels[kNumScales].at(u, v)];
  }
  constexpr int stride = SmoothShared::kStride;
  for (int i = thread; i < stride * stride; i += kAdaptiveThreads) {
    const LevelCuda& finest = job.levels[0];
    const int u = tile.u(0) - kReach + i % stride, v = tile.v(0) - kReach + i / stride;
    const bool is_near = u < finest.width + kReach && v < finest.height + kReach;
    shared.mean[i] = is_near ? means[finest.at(u, v)] : 0.0f;
    shared.predicted[i] = is_near ? predictions[finest.at(u, v)] : 0.0f;
  }
#pragma unroll
  for (int number = kNumScales - 1; number >= 0; --number) {
    __syncthreads();
    const LevelCuda& level = job.levels[number];
    const ScaleNoise noise = job.noise[tile.image * kNumScales + number];
    const int side = smoothed_side(number), reach = reach_at(number);
    const int wider_side = smoothed_side(number + 1);
    const int border = reach_at(number + 1) - reach / 2;  // wider cells around those that are used
    const float* const wider = shared.cells[(number + 1) % 2];
    float* const smoothed = shared.cells[number % 2];
    if (thread < side / 2 * (side / 2)) {
      const int y = thread / (side / 2), x = thread % (side / 2);
      predict_cells(wider + (y + border) * wider_side + x + border, wider_side, number + 1,
                    smoothed + 2 * (y * side + x), side);
    }
    if (thread == 0) shared.num_kept = 0;
    __syncthreads();
    // Smooths cell i, or leaves it to the list.
    const auto smooth = [&](int i, bool is_listed) {
      const int x = i % side, y = i / side;
      const int u = tile.u(number) - reach + x, v = tile.v(number) - reach + y;
      const bool is_inside = u >= 0 && v >= 0 && u < level.width && v < level.height;
      const int at = level.at(u, v), near = (y + kReach) * stride + x + kReach;
      const float* const mean = number == 0 ? shared.mean + near : means + at;
      const float* const predicted = number == 0 ? shared.predicted + near : predictions + at;
      float result = 0;
      if (is_inside) {
        const float energy = job.energy[first + at];
        float detail = *mean - *predicted;
        if (is_listed) {
          detail = calm_detail(number, mean, predicted, number == 0 ? stride : level.stride, noise);
        } else if (number < kCalmLevels && is_kept(*mean, *predicted, energy)) {
          return true;
        }
        result = smoothed_cell(*mean, detail, *predicted, smoothed[i], energy, noise);
      }
      if (number > 0) {
        smoothed[i] = result;
      } else if (is_inside) {
        const unsigned free = job.free[filter.tiling.word(tile.image, v, tile.column)];
        depth[static_cast<std::ptrdiff_t>(v) * level.width + u] =
            (free >> x & 1) != 0 ? kFar : (result > 0 ? 1.0f / result : kNotMeasured);
      }
      return false;
    };
    for (int begin = 0; begin < side * side; begin += kAdaptiveThreads) {
      const int i = begin + thread;
      const bool is_left = i < side * side && smooth(i, false);
      const unsigned left = __ballot_sync(gpu::kWholeWarp, is_left);
      if (left == 0) continue;
      int place = 0;
      if (gpu::lane_id() == 0) place = atomicAdd(&shared.num_kept, __popc(left));
      place = __shfl_sync(gpu::kWholeWarp, place, 0);
      const unsigned before = left & ((1u << gpu::lane_id()) - 1);
      if (is_left) shared.kept[place + __popc(before)] = static_cast<std::uint16_t>(i);
    }
    if (number >= kCalmLevels) continue;
    __syncthreads();
    for (int k = thread; k < shared.num_kept; k += kAdaptiveThreads) smooth(shared.kept[k], true);
  }
}
static_assert(smoothed_side(0) / 2 * (smoothed_side(0) / 2) <= kAdaptiveThreads);
static_assert(smoothed_side(kNumScales) * smoothed_side(kNumScales) <= kAdaptiveThreads);

}}}}  // namespace palpate::v0::one_lane
