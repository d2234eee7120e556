// Alternative to a depth field: a grid of signed distances, interpolated trilinearly at each
// sphere, with a hinge cost. A lean kernel of our own: a block for each pose, and per pose the cost
// and the wrench of its gradient.
#pragma once

#include <algorithm>
#include <vector>

#include "bench/contact_setup.h"
#include "eval/studies/trilinear.h"
#include "src/gpu/internal/runtime.h"
#include "src/gpu/internal/team.cuh"

namespace palpate::bench {

struct DistanceGrid {
  float origin[3] = {}, cells_per_meter = 1;
  int num[3] = {};
  const float* distances = nullptr;
};

/// Makes the grid of bumpy_wall: its distances along z, which suffice for timing.
inline DistanceGrid wall_distances(double cell, gpu::Memory& memory) {
  constexpr double kLow[] = {-0.65, -0.65, 0.55}, kHigh[] = {0.65, 0.65, 1.15};
  DistanceGrid grid;
  grid.cells_per_meter = static_cast<float>(1 / cell);
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
  float* answers = nullptr;  // 7 per pose
};

__global__ void __launch_bounds__(256) query_grid(const __grid_constant__ GridJob job) {
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
    for (int axis = 0; axis < 3; ++axis) {
      const float(&r)[3] = shared.R[axis];
      lever[axis] = r[0] * s.center.x + r[1] * s.center.y + r[2] * s.center.z;
      at[axis] = (lever[axis] + shared.p[axis] - grid.origin[axis]) * grid.cells_per_meter;
    }
    eval::TrilinearCell<float> cell;
    if (!cell.find(at, grid.num)) continue;
    const float depth = s.radius - cell.distance(grid.distances, grid.num);
    if (!(depth > 0)) continue;
    float n[3];
    cell.gradient(n);
    for (float& component : n) component *= grid.cells_per_meter;
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
