// What others ask instead of a depth field: a grid of signed distances, looked up trilinearly at
// each sphere, with a hinge. Our own kernel of it, as lean as we can make it: a block for each
// pose, and per pose the cost and the wrench of its gradient.
#pragma once

#include <algorithm>
#include <vector>

#include "bench/contact_setup.h"
#include "src/gpu/runtime.h"
#include "src/gpu/team.cuh"

namespace palpate::bench {

struct DistanceGrid {
  float origin[3] = {}, cells_per_metre = 1;
  int num[3] = {};
  const float* distances = nullptr;
};

/// Of what bumpy_wall shows: its distances along z, which is what counts for a time.
inline DistanceGrid wall_distances(double cell, gpu::Memory& memory) {
  constexpr double kLow[] = {-0.65, -0.65, 0.55}, kHigh[] = {0.65, 0.65, 1.15};
  DistanceGrid grid;
  grid.cells_per_metre = static_cast<float>(1 / cell);
  for (int axis = 0; axis < 3; ++axis) {
    grid.origin[axis] = static_cast<float>(kLow[axis]);
    grid.num[axis] = static_cast<int>((kHigh[axis] - kLow[axis]) / cell) + 1;
  }
  std::vector<float> distances;
  for (int k = 0; k < grid.num[2]; ++k) {
    for (int j = 0; j < grid.num[1]; ++j) {
      for (int i = 0; i < grid.num[0]; ++i) {
        const double x = kLow[0] + cell * i, y = kLow[1] + cell * j, z = kLow[2] + cell * k;
        const double wall = kWallDepth + 0.01 * std::sin(26 * x / z) * std::cos(31 * y / z);
        distances.push_back(static_cast<float>(wall - z));
      }
    }
  }
  grid.distances = memory.copy_of(distances);
  return grid;
}

struct GridJob {
  DistanceGrid grid;
  const Sphere* spheres = nullptr;
  int num_spheres = 0;
  const Pose* X_WT = nullptr;
  float* answers = nullptr;  // 7 a pose
};

__global__ void __launch_bounds__(256) ask_grid(const __grid_constant__ GridJob job) {
  struct Shared {
    float R[3][3], p[3];
    float sums[8][7];
  };
  auto& shared = gpu::shared_memory<Shared>();
  const int thread = static_cast<int>(threadIdx.x);
  if (thread == 0) {
    const Pose X_WT = job.X_WT[blockIdx.x];
    const Mat3d R = rotation_matrix(X_WT.rotation);
    for (int i = 0; i < 9; ++i) shared.R[i / 3][i % 3] = static_cast<float>(R.m[i / 3][i % 3]);
    for (int axis = 0; axis < 3; ++axis) {
      shared.p[axis] = static_cast<float>(X_WT.translation[axis]);
    }
  }
  __syncthreads();
  const DistanceGrid& grid = job.grid;
  float sums[7] = {};
  for (int i = thread; i < job.num_spheres; i += static_cast<int>(blockDim.x)) {
    const Sphere s = job.spheres[i];
    float lever[3], at[3];
    int cell[3];
    bool is_inside = true;
    for (int axis = 0; axis < 3; ++axis) {
      const float(&r)[3] = shared.R[axis];
      lever[axis] = r[0] * s.centre.x + r[1] * s.centre.y + r[2] * s.centre.z;
      const float p = (lever[axis] + shared.p[axis] - grid.origin[axis]) * grid.cells_per_metre;
      is_inside = is_inside && p >= 0 && p < static_cast<float>(grid.num[axis] - 1);
      cell[axis] = static_cast<int>(p);
      at[axis] = p - static_cast<float>(cell[axis]);
    }
    if (!is_inside) continue;
    const int row = grid.num[0], slice = grid.num[0] * grid.num[1];
    const float* const d = grid.distances + cell[2] * slice + cell[1] * row + cell[0];
    const float c000 = d[0], c100 = d[1], c010 = d[row], c110 = d[row + 1];
    const float c001 = d[slice], c101 = d[slice + 1], c011 = d[slice + row],
                c111 = d[slice + row + 1];
    const auto mix = [](float a, float b, float t) { return a + t * (b - a); };
    const float x00 = mix(c000, c100, at[0]), x10 = mix(c010, c110, at[0]);
    const float x01 = mix(c001, c101, at[0]), x11 = mix(c011, c111, at[0]);
    const float y0 = mix(x00, x10, at[1]), y1 = mix(x01, x11, at[1]);
    const float depth = s.radius - mix(y0, y1, at[2]);
    if (!(depth > 0)) continue;
    const float gx =
        mix(mix(c100 - c000, c110 - c010, at[1]), mix(c101 - c001, c111 - c011, at[1]), at[2]);
    const float gy = mix(x10 - x00, x11 - x01, at[2]), gz = y1 - y0;
    const float n[3] = {gx * grid.cells_per_metre, gy * grid.cells_per_metre,
                        gz * grid.cells_per_metre};
    sums[0] += depth;
    for (int a = 0; a < 3; ++a) {
      const int b = (a + 1) % 3, c = (a + 2) % 3;
      sums[1 + a] += n[a];
      sums[4 + a] += lever[b] * n[c] - lever[c] * n[b];
    }
  }
  for (float& sum : sums) sum = gpu::warp_sum(sum);
  if (gpu::lane_id() == 0) {
    for (int k = 0; k < 7; ++k) shared.sums[gpu::warp_id()][k] = sums[k];
  }
  __syncthreads();
  if (thread < 7) {
    float sum = 0;
    for (int warp = 0; warp < gpu::warps_per_block(); ++warp) sum += shared.sums[warp][thread];
    job.answers[blockIdx.x * 7 + threadIdx.x] = sum;
  }
}

}  // namespace palpate::bench
