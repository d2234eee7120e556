#include "src/cloud/surface/adaptive/adaptive_cuda.h"

#include <limits>

#include "src/cloud/surface/adaptive/noise_fit.h"
#include "src/cloud/surface/adaptive/scale_rules.h"
#include "src/cloud/surface/surface_kernels.h"
#include "src/gpu/internal/team.cuh"

namespace palpate { inline namespace v0 {
namespace one_lane { namespace {

constexpr float kNotMeasured = std::numeric_limits<float>::quiet_NaN();
constexpr int kTileSide = 1 << kNumScales;  // pixels
constexpr int kAdaptiveThreads = 256;
constexpr int kReach = 2;            // cells, of a prediction
constexpr int kMargin = 2 * kReach;  // cells, of a level
constexpr int kNoiseThreads = (kNumScales * DetailCounts::kDepths + 31) / 32 * 32;

/// Number of the first cell of a level among those of a tile, which are counted level by level.
PALPATE_HOSTDEV constexpr int first_cell(int level) {
  return 4 * (kTileSide * kTileSide - (kTileSide * kTileSide >> 2 * level)) / 3;
}
constexpr int kTileCells = first_cell(kNumScales + 1);

/// A cell of a tile.
struct TileCell {
  int level;
  int u, v;  // in the image
  bool is_inside;
  std::ptrdiff_t at;  // in the arrays of its level
  int finer;          // number of the upper left of its cells of the next finer level, if any
};

/// Position of a block.
struct ScaleTile {
  int image, column, row;

  __device__ explicit ScaleTile(const AdaptiveJob& job) {
    const LevelCuda& widest = job.levels[kNumScales];
    const int num = widest.width * widest.height, block = static_cast<int>(blockIdx.x);
    image = block / num;
    row = (block - image * num) / widest.width;
    column = block - image * num - row * widest.width;
  }
  /// The cell of a number.
  __device__ TileCell cell(const AdaptiveJob& job, int number) const {
    TileCell cell;
    cell.level = 0;
    while (number >= first_cell(cell.level + 1)) ++cell.level;
    const LevelCuda& level = job.levels[cell.level];
    const int side = kTileSide >> cell.level, rest = number - first_cell(cell.level);
    const int y = rest / side, x = rest - y * side;
    cell.u = column * side + x;
    cell.v = row * side + y;
    cell.is_inside = cell.u < level.width && cell.v < level.height;
    cell.at = image * job.cells_apart + level.at(cell.u, cell.v);
    cell.finer = first_cell(cell.level) - 4 * side * side + 2 * (y * 2 * side + x);
    return cell;
  }
};

/// A number of each cell of a tile.
struct TileCells {
  float cells[kTileCells];
};

/// Level 0 of the depth, and all wider ones from it.
__global__ void __launch_bounds__(kAdaptiveThreads)
    widen_scales(const __grid_constant__ AdaptiveJob job) {
  float* const cells = gpu::shared_memory<TileCells>().cells;
  const ScaleTile tile(job);
  const int thread = static_cast<int>(threadIdx.x);
  const float* const depth = job.depth + tile.image * job.depth_apart;
  for (int level = 0; level <= kNumScales; ++level) {
    const int side = kTileSide >> level;
    const float tolerance = scale_tolerance(level);
    for (int i = first_cell(level) + thread; i < first_cell(level + 1); i += kAdaptiveThreads) {
      const TileCell cell = tile.cell(job, i);
      float mean = 0;
      if (level > 0) {
        const float* const above = cells + cell.finer;
        const float* const below = above + 2 * side;
        mean = joined_cells(above[0], above[1], below[0], below[1], tolerance);
      } else if (cell.is_inside) {
        const float z = depth[static_cast<std::ptrdiff_t>(cell.v) * job.levels[0].width + cell.u];
        mean = z < kAnyDepth ? 1.0f / z : 0.0f;
      }
      cells[i] = mean;
      if (cell.is_inside) job.levels[level].mean[cell.at] = mean;
    }
    __syncthreads();
  }
}

/// The predictions of the two by two cells of a cell.
struct FinerCells {
  float cells[2][2];
};
__device__ inline FinerCells predicted_cells(const float* at, std::ptrdiff_t stride, int level) {
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
  FinerCells finer;
#pragma unroll
  for (int row = 0; row < 2; ++row) {
    const float* const halves = row == 0 ? lower : upper;
    const float center = row == 0 ? mean - down.change : mean + down.change;
    const Halves h = halves_of(halves[0], halves[1], halves[2], halves[3], halves[4]);
    finer.cells[row][0] = predicted_cell(h.lower, center - across.change, mean, has_plane);
    finer.cells[row][1] = predicted_cell(h.upper, center + across.change, mean, has_plane);
  }
  return finer;
}

/// All levels from the next wider ones; counts the details.
__global__ void __launch_bounds__(kAdaptiveThreads)
    predict_scales(const __grid_constant__ AdaptiveJob job) {
  const ScaleTile tile(job);
  const int first = first_cell(1) + static_cast<int>(threadIdx.x);
  for (int i = first; i < kTileCells; i += kAdaptiveThreads) {
    const TileCell cell = tile.cell(job, i);
    if (!cell.is_inside) continue;
    const int number = cell.level - 1, step = count_step(number);
    const LevelCuda& wider = job.levels[cell.level];
    const LevelCuda& level = job.levels[number];
    const FinerCells finer = predicted_cells(wider.mean + cell.at, wider.stride, cell.level);
    for (int k = 0; k < 4; ++k) {
      const int u = 2 * cell.u + k % 2, v = 2 * cell.v + k / 2;
      if (u >= level.width || v >= level.height) continue;
      const std::ptrdiff_t at = tile.image * job.cells_apart + level.at(u, v);
      const float mean = level.mean[at], predicted = finer.cells[k / 2][k % 2];
      level.predicted[at] = predicted;
      if (u % step != 0 || v % step != 0 || !(mean > 0 && predicted > 0)) continue;
      const DetailPlace place = place_of(mean, mean - predicted);
      DetailCounts& counts = job.counts[tile.image * kNumScales + number];
      atomicAdd(&counts.counts[place.depth][place.size], std::uint32_t{1});
    }
  }
}

struct NoiseShared {
  NoiseByDepth by_depth[kNumScales];
};

/// A block finds the noise of all levels of an image.
__global__ void __launch_bounds__(kNoiseThreads)
    find_noise(const __grid_constant__ AdaptiveJob job) {
  NoiseShared& shared = gpu::shared_memory<NoiseShared>();
  const int first = static_cast<int>(blockIdx.x) * kNumScales;  // of the image
  const int level = static_cast<int>(threadIdx.x) / DetailCounts::kDepths;
  const int z = static_cast<int>(threadIdx.x) % DetailCounts::kDepths;
  if (level < kNumScales) {
    shared.by_depth[level][z] = detail_noise(job.counts[first + level].counts[z], z);
  }
  __syncthreads();
  if (threadIdx.x == 0) fit_noise(shared.by_depth, job.noise + first);
}

/// Energy of a cell's neighborhood beyond that of noise.
__device__ inline float own_energy(const LevelCuda& level, std::ptrdiff_t at,
                                   const ScaleNoise& noise) {
  float sums[3], weights[3];  // of columns
#pragma unroll
  for (int column = 0; column < 3; ++column) {
    sums[column] = weights[column] = 0;
#pragma unroll
    for (int row = -1; row <= 1; ++row) {
      const std::ptrdiff_t i = at + row * level.stride + column - 1;
      const float mean = level.mean[i], predicted = level.predicted[i];
      if (!(mean > 0 && predicted > 0)) continue;
      const float share = row == 0 ? 2.0f : 1.0f;
      sums[column] += share * energy_of(mean, predicted, noise);
      weights[column] += share;
    }
  }
  return excess_of(sums[0] + 2.0f * sums[1] + sums[2], weights[0] + 2.0f * weights[1] + weights[2],
                   level.mean[at], noise);
}

/// The energy of all levels, with that of the finer ones.
__global__ void __launch_bounds__(kAdaptiveThreads)
    find_energies(const __grid_constant__ AdaptiveJob job) {
  float* const cells = gpu::shared_memory<TileCells>().cells;
  const ScaleTile tile(job);
  const int thread = static_cast<int>(threadIdx.x);
  const ScaleNoise* const noise = job.noise + tile.image * kNumScales;
  for (int i = thread; i < first_cell(kNumScales); i += kAdaptiveThreads) {
    const TileCell cell = tile.cell(job, i);
    cells[i] = cell.is_inside ? own_energy(job.levels[cell.level], cell.at, noise[cell.level]) : 0;
  }
  for (int level = 0; level < kNumScales; ++level) {
    const int side = kTileSide >> level;
    __syncthreads();
    for (int i = first_cell(level) + thread; i < first_cell(level + 1); i += kAdaptiveThreads) {
      const TileCell cell = tile.cell(job, i);
      if (level > 0) {
        const float* const above = cells + cell.finer;
        const float* const below = above + 2 * side;
        cells[i] = max(cells[i], max(max(above[0], above[1]), max(below[0], below[1])));
      }
      if (cell.is_inside) job.levels[level].energy[cell.at] = cells[i];
    }
  }
}

/// Energy of a cell with that of the wider ones around it.
__device__ inline float energy_at(const AdaptiveJob& job, int image, int number, int u, int v) {
  float energy = 0;
  for (int level = kNumScales - 1; level >= number; --level) {
    const LevelCuda& around = job.levels[level];
    const int up = level - number;
    const float own = around.energy[image * job.cells_apart + around.at(u >> up, v >> up)];
    energy = max(own, kFinerShare * energy);
  }
  return energy;
}

/// Cells around a tile that its smoothing needs of a level, each way: an even number.
PALPATE_HOSTDEV constexpr int reach_at(int level) {
  return level == 0 ? 0 : level == 1 ? kReach : 2 * kReach;
}
PALPATE_HOSTDEV constexpr int smoothed_side(int level) {
  return (kTileSide >> level) + 2 * reach_at(level);
}

/// Smoothed cells of a tile and around it, of the level that is made and of the wider one.
struct SmoothShared {
  float cells[2][smoothed_side(1) * smoothed_side(1)];
};

/// Smooths all levels, from the widest on. What tiles need of their neighbors, they make, too.
__global__ void __launch_bounds__(kAdaptiveThreads)
    smooth_scales(const __grid_constant__ AdaptiveJob job) {
  SmoothShared& shared = gpu::shared_memory<SmoothShared>();
  const ScaleTile tile(job);
  const int thread = static_cast<int>(threadIdx.x);
  const std::ptrdiff_t first = tile.image * job.cells_apart;
  float* const depth = job.depth + tile.image * job.depth_apart;

  const LevelCuda& widest = job.levels[kNumScales];
  constexpr int widest_side = smoothed_side(kNumScales), widest_reach = reach_at(kNumScales);
  for (int i = thread; i < widest_side * widest_side; i += kAdaptiveThreads) {
    const int u = tile.column - widest_reach + i % widest_side;
    const int v = tile.row - widest_reach + i / widest_side;
    shared.cells[kNumScales % 2][i] = widest.mean[first + widest.at(u, v)];
  }
  for (int number = kNumScales - 1; number >= 0; --number) {
    __syncthreads();
    const LevelCuda& level = job.levels[number];
    const ScaleNoise noise = job.noise[tile.image * kNumScales + number];
    const int side = smoothed_side(number), reach = reach_at(number);
    const int wider_side = smoothed_side(number + 1);
    const int border = reach_at(number + 1) - reach / 2;  // wider cells around those that are used
    const float* const wider = shared.cells[(number + 1) % 2];
    float* const smoothed = shared.cells[number % 2];
    for (int i = thread; i < side / 2 * (side / 2); i += kAdaptiveThreads) {
      const int row = i / (side / 2), column = i - row * (side / 2);
      const FinerCells finer = predicted_cells(
          wider + (row + border) * wider_side + column + border, wider_side, number + 1);
      for (int k = 0; k < 4; ++k) {
        const int x = 2 * column + k % 2, y = 2 * row + k / 2;
        const int u = tile.column * (kTileSide >> number) - reach + x;
        const int v = tile.row * (kTileSide >> number) - reach + y;
        const bool is_inside = u >= 0 && v >= 0 && u < level.width && v < level.height;
        float result = 0;
        if (is_inside) {
          const std::ptrdiff_t at = first + level.at(u, v);
          const float* const mean = level.mean + at;
          const float* const predicted = level.predicted + at;
          const float energy = energy_at(job, tile.image, number, u, v);
          float detail = *mean - *predicted;
          if (number < kCalmLevels && is_kept(*mean, *predicted, energy)) {
            detail = calm_detail(number, mean, predicted, level.stride, noise);
          }
          result =
              smoothed_cell(*mean, detail, *predicted, finer.cells[k / 2][k % 2], energy, noise);
        }
        if (number > 0) {
          smoothed[y * side + x] = result;
        } else if (is_inside) {
          depth[static_cast<std::ptrdiff_t>(v) * level.width + u] =
              result > 0 ? 1.0f / result : kNotMeasured;
        }
      }
    }
  }
}

}}  // namespace one_lane

AdaptiveCuda::AdaptiveCuda(gpu::Memory& memory, int width, int height, int num_images, float* depth,
                           std::ptrdiff_t depth_apart) {
  constexpr int kMargin = one_lane::kMargin;
  for (LevelCuda& level : job_.levels) {
    level.width = width;
    level.height = height;
    level.stride = width + 2 * kMargin;
    job_.cells_apart += level.stride * (height + 2 * kMargin);
    width = (width + 1) / 2;
    height = (height + 1) / 2;
  }
  const auto num = static_cast<std::size_t>(num_images);
  float* arrays[3];
  for (float*& array : arrays) {
    array = memory.take<float>(num * static_cast<std::size_t>(job_.cells_apart));
  }
  std::ptrdiff_t first = 0;  // cell of a level in each array
  for (LevelCuda& level : job_.levels) {
    const std::ptrdiff_t at = first + level.at(kMargin, kMargin);
    level.mean = arrays[0] + at;
    level.predicted = arrays[1] + at;
    level.energy = arrays[2] + at;
    first += level.stride * (level.height + 2 * kMargin);
  }
  job_.depth = depth;
  job_.depth_apart = depth_apart;
  job_.counts = memory.take<DetailCounts>(num * kNumScales);
  job_.noise = memory.take<ScaleNoise>(num * kNumScales);
}

void AdaptiveCuda::enqueue(gpu::Stream& stream, int num_images) const {
  const LevelCuda& widest = job_.levels[kNumScales];
  const auto tiles = [&](std::size_t shared_bytes) {
    return gpu::LaunchShape{.blocks = num_images * widest.width * widest.height,
                            .threads = one_lane::kAdaptiveThreads,
                            .shared_bytes = shared_bytes};
  };
  stream.clear(job_.counts,
               static_cast<std::size_t>(num_images) * kNumScales * sizeof(DetailCounts));
  gpu::launch(stream, tiles(sizeof(one_lane::TileCells)), one_lane::widen_scales, job_);
  gpu::launch(stream, tiles(0), one_lane::predict_scales, job_);
  gpu::launch(stream,
              {.blocks = num_images,
               .threads = one_lane::kNoiseThreads,
               .shared_bytes = sizeof(one_lane::NoiseShared)},
              one_lane::find_noise, job_);
  gpu::launch(stream, tiles(sizeof(one_lane::TileCells)), one_lane::find_energies, job_);
  gpu::launch(stream, tiles(sizeof(one_lane::SmoothShared)), one_lane::smooth_scales, job_);
}

}}  // namespace palpate::v0
