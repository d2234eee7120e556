// The noise of a measure from the elements that touch (noise_grid.h), by a block of a GPU. Threads
// add to a node in any order, so nodes are integers: of each number, 2^30 is more than all elements
// together can add to a node. Rounding takes away less than that of single precision in sums of as
// many nodes, and the sums have the same bits on every run.
#pragma once

#include <cmath>
#include <cstdint>

#include "src/contact/cuda/finish_measure.cuh"
#include "src/contact/field/field_elements_cuda.cuh"
#include "src/contact/noise/noise_grid.h"

namespace palpate { inline namespace v0 { namespace {

/// Numbers of MeasureNoise: seven variances, and two times three covariances with the next axis.
constexpr int kNumVariances = 13;
constexpr int kFirstProduct = kNumChanges;

/// Sums over the elements of a camera: three of NoiseReach, then what the depth at an element
/// changes by itself and by its slopes in the image, at most.
constexpr int kNumReachSums = 16, kFirstBound = 3, kFirstSlope = kFirstBound + kNumChanges;
static_assert(kFirstSlope + kNumChanges - 1 == kNumReachSums);

/// A number of a node, first in units of its own.
union NoiseSum {
  std::int32_t whole;
  float number;
};
/// Nodes of a grid, and of one that was made from a finer grid.
constexpr int kMaxNodes = kNoiseNodes * kNoiseNodes;
constexpr int kMaxWideNodes = (kNoiseNodes / 2 + 2) * (kNoiseNodes / 2 + 2);

/// A grid in shared memory: number by number, so that neighbors lie in different banks.
struct SharedGrid {
  CellWindow window;
  NoiseSum* sums;
  int apart;  ///< from one number to the next

  __device__ int wide() const { return window.right - window.left + 1; }
  __device__ int num() const { return wide() * (window.bottom - window.top + 1); }
  __device__ NoiseSum& at(int k, int node) const { return sums[k * apart + node]; }
};

/// Shared memory of the sums; `variances` are those of all cameras that were added.
template <int kWarps>
struct NoiseScratch {
  double variances[kNumVariances];

  NoiseSum nodes[kNumChanges * kMaxNodes], wide[kNumChanges * kMaxWideNodes];
  double sums[kWarps][kNumReachSums];
  float edges[kWarps][4];  // least u, v, and those of -u, -v
  double of_grids[kNumNoiseLevels][kWarps][kNumReachSums];
  NoiseReach reach;
  CellWindow window;
  NoiseScales scales;
  float units[kNumChanges];  // of the nodes, powers of two: so many make 1
  // Windows in which the field is looked at, the noise of their cells, and what is left of it.
  int num_looks;
  CellWindow looks[kLastSmoothed + 1];
  float look_variances[kLastSmoothed + 1], left[kLastSmoothed + 1];
};

// Calls f(first row, number of rows) for parts of the rows, a warp's size each.
template <class F>
__device__ void for_rows(const KeptRows& kept, const F& f) {
  const int num_warps = gpu::warps_per_block();
  const int together = num_warps > kept.num_parts ? num_warps / kept.num_parts : 1;
  for (int part = gpu::warp_id() / together; part < kept.num_parts; part += num_warps / together) {
    const int num = kept.rows.num[part];
    for (int i = gpu::warp_id() % together * gpu::kWarpSize; i < num;
         i += together * gpu::kWarpSize) {
      f(part * kept.capacity + i, num - i < gpu::kWarpSize ? num - i : gpu::kWarpSize);
    }
  }
}

// Sums up the reach of a camera's elements, and bounds of what they change. Returns true if there
// is any.
template <int kWarps>
__device__ bool sum_reach(const KeptRows& kept, int camera, const NoiseCamera& view,
                          NoiseScratch<kWarps>& shared) {
  const int lane = gpu::lane_id(), thread = static_cast<int>(threadIdx.x);
  NoiseReach reach;
  float bounds[kNumReachSums - kFirstBound] = {};
  for_rows(kept, [&](std::ptrdiff_t first, int num) {
    const std::ptrdiff_t row = first + lane;
    if (lane >= num || kept.rows.at(NoiseRow::camera, row) != static_cast<float>(camera)) return;
    reach.add(kept.rows, row);
    const NoiseChange change = noise_change(kept.rows, row, view);
#pragma unroll
    for (int k = 0; k < kNumChanges; ++k) {
      bounds[k] += fabsf(change.by_depth[k]);
      if (k > 0) bounds[kNumChanges + k - 1] += fabsf(change.by_u[k]) + fabsf(change.by_v[k]);
    }
  });
  double sums[kNumReachSums] = {reach.weight, reach.level, reach.depth};
#pragma unroll
  for (int k = kFirstBound; k < kNumReachSums; ++k) sums[k] = bounds[k - kFirstBound];
  fold_over_warp<kNumReachSums / 2, 2>(sums);
  sums[0] += __shfl_xor_sync(gpu::kWholeWarp, sums[0], 1);
  if (lane % 2 == 0) shared.sums[gpu::warp_id()][lane / 2] = sums[0];
  float edges[4] = {reach.min_u, reach.min_v, -reach.max_u, -reach.max_v};
  for (float& edge : edges) {
    for (int step = gpu::kWarpSize / 2; step > 0; step /= 2) {
      edge = fminf(edge, __shfl_xor_sync(gpu::kWholeWarp, edge, step));
    }
  }
  if (lane < 4) shared.edges[gpu::warp_id()][lane] = edges[lane];
  __syncthreads();
  if (thread < kNumReachSums) {
    double sum = 0;
    for (int warp = 0; warp < gpu::warps_per_block(); ++warp) sum += shared.sums[warp][thread];
    shared.sums[0][thread] = sum;
  } else if (thread < kNumReachSums + 4) {
    const int edge = thread - kNumReachSums;
    float least = shared.edges[0][edge];
    for (int warp = 1; warp < gpu::warps_per_block(); ++warp) {
      least = fminf(least, shared.edges[warp][edge]);
    }
    shared.edges[0][edge] = least;
  }
  __syncthreads();
  const bool has_any = shared.sums[0][0] != 0;
  __syncthreads();
  return has_any;
}

// Chooses the grid, and what has to be known of the field. One thread calls.
template <int kWarps>
__device__ void choose_grid(const FieldGrid& grid, const FrameNoise& noise,
                            NoiseScratch<kWarps>& shared) {
  const double(&sums)[kNumReachSums] = shared.sums[0];
  const float(&edges)[4] = shared.edges[0];
  NoiseReach& reach = shared.reach;
  reach.min_u = edges[0];
  reach.min_v = edges[1];
  reach.max_u = -edges[2];
  reach.max_v = -edges[3];
  reach.weight = static_cast<float>(sums[0]);
  reach.level = static_cast<float>(sums[1]);
  reach.depth = static_cast<float>(sums[2]);
  shared.window = noise_window(reach);
  shared.scales = noise_scales(noise, reach.depth / reach.weight);
  shared.num_looks = 0;
  // As much as may be asked for is lost where nothing is left.
  NoiseScales lost = shared.scales;
  place_scales(
      shared.window,
      [&](const CellWindow& window, float variance) {
        const int number = shared.num_looks++;
        shared.looks[number] = window;
        shared.look_variances[number] = variance;
        shared.left[number] = window.level > grid.last_level ? 1.0f : -1.0f;
        return 0.0f;
      },
      lost);
}

// Looks at the field in all windows, each by a warp.
template <int kWarps>
__device__ void look_at_bends(const FieldGrid& grid, const FieldPixels& pixels,
                              NoiseScratch<kWarps>& shared) {
  for (int i = gpu::warp_id(); i < shared.num_looks; i += gpu::warps_per_block()) {
    if (!(shared.left[i] < 0)) continue;
    const CellWindow& window = shared.looks[i];
    const int step_u = step_over(window.left, window.right);
    const int step_v = step_over(window.top, window.bottom);
    const int num_u = 1 + (window.right - window.left) / step_u;
    const int num = num_u * (1 + (window.bottom - window.top) / step_v);
    SeenBends bends;
    for (int k = gpu::lane_id(); k < num; k += gpu::kWarpSize) {
      bends.add(grid, pixels, window.level, window.left + k % num_u * step_u,
                window.top + k / num_u * step_v, shared.look_variances[i]);
    }
    bends.sum = gpu::warp_sum(bends.sum);
    bends.num = gpu::warp_sum(bends.num);
    __syncwarp();
    if (gpu::lane_id() == 0) shared.left[i] = bends.share();
    __syncwarp();
  }
}

// Adds the elements of a camera to the nodes, in their units.
__device__ inline void add_to_nodes(const KeptRows& kept, int camera, const NoiseCamera& view,
                                    const float (&units)[kNumChanges], const SharedGrid& grid) {
  const CellWindow& window = grid.window;
  const float scale = 1 / static_cast<float>(1 << window.level);
  for_rows(kept, [&](std::ptrdiff_t first, int num) {
    const std::ptrdiff_t row = first + gpu::lane_id();
    if (gpu::lane_id() >= num) return;
    if (kept.rows.at(NoiseRow::camera, row) != static_cast<float>(camera)) return;
    const NoiseChange change = noise_change(kept.rows, row, view);
    const NodeWeights u = node_weights(kept.rows.at(NoiseRow::u, row), window.left, scale);
    const NodeWeights v = node_weights(kept.rows.at(NoiseRow::v, row), window.top, scale);
#pragma unroll
    for (int k = 0; k < kNumChanges; ++k) {
      const float by_depth = change.by_depth[k] * units[k], by_u = change.by_u[k] * units[k],
                  by_v = change.by_v[k] * units[k];
#pragma unroll
      for (int q = 0; q < 3; ++q) {
        const float plain = by_depth * v.value[q] + by_v * v.slope[q], sloped = by_u * v.value[q];
        NoiseSum* const nodes = &grid.at(k, (v.first + q) * grid.wide() + u.first);
#pragma unroll
        for (int p = 0; p < 3; ++p) {
          atomicAdd(&nodes[p].whole, __float2int_rn(plain * u.value[p] + sloped * u.slope[p]));
        }
      }
    }
  });
}

// Adds the squares of a grid's nodes, and products of neighboring axes, in the order of
// add_variances. Each warp has its own `to`.
__device__ inline void add_squares(const SharedGrid& grid, double* to) {
  constexpr int kNextAxis[kNumChanges] = {0, 2, 3, 1, 5, 6, 4};
  float sums[kNumVariances] = {};
  for (int i = static_cast<int>(threadIdx.x); i < grid.num(); i += static_cast<int>(blockDim.x)) {
    float node[kNumChanges];
#pragma unroll
    for (int k = 0; k < kNumChanges; ++k) node[k] = grid.at(k, i).number;
#pragma unroll
    for (int k = 0; k < kNumChanges; ++k) {
      sums[k] += node[k] * node[k];
      if (k > 0) sums[kFirstProduct + k - 1] += node[k] * node[kNextAxis[k]];
    }
  }
  double values[kNumReachSums] = {};
#pragma unroll
  for (int k = 0; k < kNumVariances; ++k) values[k] = sums[k];
  fold_over_warp<kNumReachSums / 2, 2>(values);
  values[0] += __shfl_xor_sync(gpu::kWholeWarp, values[0], 1);
  if (gpu::lane_id() % 2 == 0) to[gpu::lane_id() / 2] = values[0];
}

// Makes the grid of the next wider level.
__device__ inline void widen(const SharedGrid& finer, const SharedGrid& to) {
  const CellWindow& window = to.window;
  for (int i = static_cast<int>(threadIdx.x); i < to.num(); i += static_cast<int>(blockDim.x)) {
    float node[kNumChanges] = {};
    for_finer_nodes(finer.window, window.left + i % to.wide(), window.top + i / to.wide(),
                    [&](float weight, int u, int v) {
                      const int from =
                          (v - finer.window.top) * finer.wide() + u - finer.window.left;
#pragma unroll
                      for (int k = 0; k < kNumChanges; ++k) {
                        node[k] += weight * finer.at(k, from).number;
                      }
                    });
#pragma unroll
    for (int k = 0; k < kNumChanges; ++k) to.at(k, i).number = node[k];
  }
}

/// Adds the noise that a camera causes by the elements that it decides. `field`: of the camera,
/// whose axes are R_WC. The whole block calls, after its threads can read the rows.
template <int kWarps>
__device__ void add_noise(const KeptRows& kept, int camera, const FieldLook& field,
                          const float (&R_WC)[3][3], const SurfaceNoise& noise,
                          NoiseScratch<kWarps>& shared) {
  const int thread = static_cast<int>(threadIdx.x), num_threads = static_cast<int>(blockDim.x);
  NoiseCamera view{
      .fx = field.grid.fx, .fy = field.grid.fy, .cx = field.grid.cx, .cy = field.grid.cy};
  for (int i = 0; i < 9; ++i) view.R_WC[i / 3][i % 3] = R_WC[i / 3][i % 3];
  if (!sum_reach(kept, camera, view, shared)) return;
  if (const double* const sums = shared.sums[0]; !is_number(sums[0] + sums[1] + sums[2])) {
    if (thread < kNumVariances) shared.variances[thread] = NAN;
    __syncthreads();
    return;
  }
  if (thread == 0) choose_grid(field.grid, noise.frame, shared);
  __syncthreads();
  SharedGrid grid{shared.window, shared.nodes, kMaxNodes};
  if (thread < kNumChanges) {
    // The largest weights of a node are 3/4 each way, and the largest slopes 1 a cell.
    const double per_cell = 1 / static_cast<double>(1 << grid.window.level);
    const double* const bounds = shared.sums[0];
    double bound = 0.5625 * bounds[kFirstBound + thread];
    if (thread > 0) bound += 0.75 * per_cell * bounds[kFirstSlope + thread - 1];
    int exponent = 0;
    (void)frexpf(static_cast<float>(bound), &exponent);
    constexpr int kBits = 30, kMaxExponent = 96;
    exponent = kBits - exponent;
    shared.units[thread] = ldexpf(1, exponent < kMaxExponent ? exponent : kMaxExponent);
    if (!is_number(bound)) shared.units[thread] = NAN;  // and so are the nodes
  }
  const auto for_sums = [&](const auto& f) {
    for (int k = 0; k < kNumChanges; ++k) {
      for (int i = thread; i < grid.num(); i += num_threads) f(k, grid.at(k, i));
    }
  };
  for_sums([](int, NoiseSum& sum) { sum.whole = 0; });
  look_at_bends(field.grid, field.pixels, shared);
  __syncthreads();
  add_to_nodes(kept, camera, view, shared.units, grid);
  __syncthreads();
  for_sums([&](int k, NoiseSum& sum) {
    sum.number = static_cast<float>(sum.whole) * (1 / shared.units[k]);
  });
  __syncthreads();
  const int first = grid.window.level, num_grids = num_noise_grids(first);
  SharedGrid next{{}, shared.wide, kMaxWideNodes};
  for (int i = 0; i < num_grids; ++i) {
    add_squares(grid, shared.of_grids[i][gpu::warp_id()]);
    if (i == num_grids - 1) break;
    next.window = wider_nodes(grid.window);
    widen(grid, next);
    const SharedGrid finer = grid;
    grid = next;
    next = finer;
    __syncthreads();
  }
  if (thread == 0) {
    int number = 0;
    place_scales(
        shared.window,
        [&](const CellWindow& at, float) {
          while (shared.looks[number].level != at.level) ++number;
          return shared.left[number];
        },
        shared.scales);
  }
  __syncthreads();
  if (thread < kNumVariances) {
    double sum = 0;
    for (int i = 0; i < num_grids; ++i) {
      double of_grid = 0;
      for (int warp = 0; warp < gpu::warps_per_block(); ++warp) {
        of_grid += shared.of_grids[i][warp][thread];
      }
      sum += static_cast<double>(node_variance(shared.scales, first + i)) * of_grid;
    }
    shared.variances[thread] += static_cast<double>(noise.share * noise.share) * sum;
  }
  __syncthreads();
}

/// Returns what the numbers of a MeasureNoise add up to.
PALPATE_HOSTDEV inline MeasureNoise measure_noise(const double* variances) {
  MeasureNoise noise;
  add_variances(variances, variances + kFirstProduct - 1, 1, noise);
  return noise;
}

}}}  // namespace palpate::v0
