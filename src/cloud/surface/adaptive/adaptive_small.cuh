// The adaptive filter of small images: a block does one image, all levels of which are in its
// shared memory. One kernel for any number of images.
#pragma once

#include <algorithm>

#include "src/cloud/surface/adaptive/adaptive_cells.cuh"
#include "src/cloud/surface/adaptive/adaptive_cuda.h"

namespace palpate { inline namespace v0 { namespace one_lane { namespace {

constexpr int kSmallThreads = 512, kSmallWarps = kSmallThreads / gpu::kWarpSize;
constexpr int kSmallBlocks = 2;  // at a time on a multiprocessor

/// A block's shared memory; behind it the means, the predictions, and the energies beside an array
/// that holds raw depths, energies of details and smoothed cells, one after the other. The counts
/// are where the last two are later.
struct SmallShared {
  NoiseShared noise;
  int num_valid;
};
constexpr std::size_t kSmallArrays = (sizeof(SmallShared) + 15) / 16 * 16;

inline std::size_t small_bytes(const LevelsCuda& levels) {
  const std::size_t cells = static_cast<std::size_t>(levels.num_cells) * sizeof(float);
  constexpr std::size_t counts = PackedCounts::kNumWords * sizeof(std::uint32_t);
  return kSmallArrays + 2 * cells + std::max(2 * cells, counts);
}

/// Calls f(u, v, number) for the cells of a level: a warp has rows, a lane columns. `is_even`: also
/// for those of wider cells that lie beyond an odd end.
template <class F>
__device__ void for_cells(const LevelCuda& level, const F& f, bool is_even = false) {
  const int width = level.width + (is_even ? level.width % 2 : 0);
  const int height = level.height + (is_even ? level.height % 2 : 0);
  for (int v = gpu::warp_id(); v < height; v += kSmallWarps) {
    for (int u = gpu::lane_id(); u < width; u += gpu::kWarpSize) f(u, v, level.at(u, v));
  }
}

/// Fills an array of the image.
__device__ inline void fill(float* cells, int num, float value) {
  for (int i = static_cast<int>(threadIdx.x); i < num; i += kSmallThreads) cells[i] = value;
}

/// Reads the raw depth of the image: into `work`, and which of it is too far.
__device__ inline void read_small(const FilterJob& filter, const LevelCuda& finest, int image,
                                  float* work, SmallShared& shared) {
  const int words = filter.tiling.tiles_per_row;
  int num_valid = 0;
  for (int i = gpu::warp_id(); i < finest.height * words; i += kSmallWarps) {
    const int v = i / words, word = i - v * words, u = word * kTileWidth + gpu::lane_id();
    const bool is_inside = u < finest.width;
    const float z = is_inside ? raw_depth(filter, image, u, v) : kNoDepth;
    const unsigned far = __ballot_sync(gpu::kWholeWarp, z > kNoDepth);
    if (gpu::lane_id() == 0) filter.far[filter.tiling.word(image, v, word)] = far;
    if (is_inside) work[finest.at(u, v)] = z;
    num_valid += z < kAnyDepth;
  }
  num_valid = gpu::warp_sum(num_valid);
  if (gpu::lane_id() == 0) atomicAdd(&shared.num_valid, num_valid);
}

/// Predicts all levels from their wider ones and counts the details.
__device__ inline void predict_small(const LevelsCuda& levels, const float* mean, float* predicted,
                                     const PackedCounts& counts) {
  for (int number = 0; number < kNumScales; ++number) {
    const LevelCuda &fine = levels[number], &coarse = levels[number + 1];
    const int step = count_step(number);
    // Whole warps count.
    for (int v = gpu::warp_id(); v < coarse.height; v += kSmallWarps) {
      for (int first = 0; first < coarse.width; first += gpu::kWarpSize) {
        const int u = first + gpu::lane_id(), at = fine.at(2 * u, 2 * v);
        const bool is_inside = u < coarse.width;
        if (is_inside) {
          predict_cells(mean + coarse.at(u, v), coarse.stride, number + 1, predicted + at,
                        fine.stride);
        }
        const auto count = [&](int cell, bool is_counted) {
          count_in_warp(counts, is_counted ? count_of(number, mean[cell], predicted[cell]) : -1);
        };
        count(at, is_inside && (step < 4 || (u % 2 == 0 && v % 2 == 0)));
        if (step > 1) continue;
        count(at + 1, is_inside);
        count(at + fine.stride, is_inside);
        count(at + fine.stride + 1, is_inside);
      }
    }
  }
}

/// The energy of all levels, with that of the finer and the wider ones. `work`: kUnknown.
__device__ inline void find_small_energies(const LevelsCuda& levels, const float* mean,
                                           const float* predicted, const ScaleNoise* noise,
                                           float* energy, float* work) {
  for (int number = 0; number < kNumScales; ++number) {
    for_cells(levels[number], [&](int, int, int at) {
      work[at] = detail_energy(mean[at], predicted[at], noise[number]);
    });
  }
  __syncthreads();
  for (int number = 0; number < kNumScales; ++number) {
    const int stride = levels[number].stride;
    const auto find = [&](int, int, int at) {
      energy[at] = own_energy(work + at, stride, mean[at], noise[number]);
    };
    for_cells(levels[number], find, true);
  }
  for (int number = 1; number < kNumScales; ++number) {
    __syncthreads();
    const LevelCuda& finer = levels[number - 1];
    for_cells(levels[number], [&](int u, int v, int at) {
      energy[at] = with_finer(energy[at], energy + finer.at(2 * u, 2 * v), finer.stride);
    });
  }
  for (int number = kNumScales - 2; number >= 0; --number) {
    __syncthreads();
    const LevelCuda& wider = levels[number + 1];
    for_cells(levels[number], [&](int u, int v, int at) {
      energy[at] = max(energy[at], kFinerShare * energy[wider.at(u / 2, v / 2)]);
    });
  }
}

/// From raw images to smoothed depth. A block does one. `noises`: what is learned of each, or null.
__global__ void __launch_bounds__(kSmallThreads, kSmallBlocks)
    smooth_small_images(const __grid_constant__ FilterJob filter,
                        const __grid_constant__ LevelsCuda levels, FrameNoise* noises) {
  SmallShared& shared = gpu::shared_memory<SmallShared>();
  float* const mean =
      reinterpret_cast<float*>(reinterpret_cast<unsigned char*>(&shared) + kSmallArrays);
  float* const predicted = mean + levels.num_cells;
  float* const energy = predicted + levels.num_cells;
  float* const work = energy + levels.num_cells;
  const PackedCounts counts{reinterpret_cast<std::uint32_t*>(energy)};
  const int image = static_cast<int>(blockIdx.x), thread = static_cast<int>(threadIdx.x);
  const LevelCuda& finest = levels[0];

  if (thread == 0) shared.num_valid = 0;
  fill(mean, 2 * levels.num_cells, 0.0f);  // and `predicted`
  if (filter.flying_gap > 0) fill(work, levels.num_cells, kNoDepth);
  __syncthreads();
  read_small(filter, finest, image, work, shared);
  __syncthreads();
  if (thread == 0 && image == 0) filter.num_valid[0] = shared.num_valid;
  for_cells(finest,
            [&](int, int, int at) { mean[at] = inverse_depth(filter, work + at, finest.stride); });
  for (int number = 1; number <= kNumScales; ++number) {
    __syncthreads();
    const LevelCuda& finer = levels[number - 1];
    for_cells(levels[number], [&](int u, int v, int at) {
      mean[at] = wider_cell(mean + finer.at(2 * u, 2 * v), finer.stride, scale_tolerance(number));
    });
  }
  __syncthreads();
  for (int i = thread; i < PackedCounts::kNumWords; i += kSmallThreads) counts.words[i] = 0;
  __syncthreads();
  predict_small(levels, mean, predicted, counts);
  __syncthreads();
  for (int row = gpu::warp_id(); row < kNumRows; row += kSmallWarps) {
    find_depth_noise(counts, row, shared.noise);
  }
  __syncthreads();
  if (gpu::warp_id() == 0) fit_noise(shared.noise);
  fill(work, levels.num_cells, kUnknown);
  __syncthreads();
  const ScaleNoise* const noise = shared.noise.noise;
  if (thread == 0 && noises != nullptr) noises[image] = frame_noise_of(noise);
  find_small_energies(levels, mean, predicted, noise, energy, work);

  float* const depth = filter.depth + image * filter.tiling.points_apart;
  for (int number = kNumScales - 1; number >= 0; --number) {
    __syncthreads();
    const LevelCuda &level = levels[number], &wider = levels[number + 1];
    // The widest cells stay as they are. Cells beyond the image have no surface, by kUnknown or, at
    // odd ends, by their wider cell, which has none.
    const float* const from = number == kNumScales - 1 ? mean : work;
    for_cells(wider, [&](int u, int v, int at) {
      predict_cells(from + at, wider.stride, number + 1, work + level.at(2 * u, 2 * v),
                    level.stride);
    });
    __syncthreads();
    for_cells(level, [&](int u, int v, int at) {
      const float result = smoothed_at(number, mean + at, predicted + at, level.stride, work[at],
                                       energy[at], noise[number]);
      if (number > 0) {
        work[at] = result;
      } else {
        depth[v * level.width + u] = result > 0 ? 1.0f / result : kNotMeasured;
      }
    });
  }
}

/// Does an image fit the shared memory of a block?
inline bool fits_a_block(const LevelsCuda& levels, int gpu) {
  constexpr std::size_t kMaxBytes = 112 << 10;
  const std::size_t bytes = small_bytes(levels);
  return bytes <= kMaxBytes &&
         gpu::resident_blocks(gpu, reinterpret_cast<const void*>(smooth_small_images),
                              kSmallThreads, bytes) > 0;
}

}}}}  // namespace palpate::v0::one_lane
