// The kernel of a batch by the field method: a block measures one pose. Its warps share the
// clusters of the tool and add them up in a fixed order, so that a pose has the same bits in any
// batch.
#pragma once

#include <cstdint>
#include <type_traits>

#include "src/contact/batch/batch_pose.h"
#include "src/contact/batch/field_batch_cuda.h"
#include "src/contact/cuda/finish_measure.cuh"
#include "src/contact/field/whole_clusters_cuda.cuh"

namespace palpate { inline namespace v0 {

// The argument of the kernel.
struct BatchJob {
  FieldTool tool;
  Vec3d p_TC;
  const Pose* X_WT = nullptr;
  const std::int32_t* surface_of_pose = nullptr;
  bool is_placed = false;      // cameras have poses; else W is C
  const Pose* X_WC = nullptr;  // of each surface; null: of the only one
  Pose first_X_WC;
  int num_surfaces = 0;
  int first_pose = 0;  // of the batch, where the surfaces' numbers are those of the poses
  const FieldLook* table = nullptr;  // of each surface; null: the first, and others like it
  FieldLook first;
  std::ptrdiff_t pixels_apart = 0, tiles_apart = 0;
  BatchAnswers out;
};

namespace {

// Threads of a block, at most.
constexpr int kBatchThreads = 4 * gpu::kWarpSize;
// Clusters that a warp adds up in single precision.
constexpr int kClustersAtOnce = gpu::kWarpSize;
// A tool that covers more tiles counts as near without a look at them.
constexpr int kMaxTiles = 2 * gpu::kWarpSize;

// Sums of a pose: volume, potential, force, torque, then StiffnessSums and zeros.
constexpr int kNumTerms = 8, kNumStiffness = 32;
template <class Sample>
constexpr int kNumSums = std::is_same_v<Sample, Curvature> ? kNumTerms + kNumStiffness : kNumTerms;

template <class Sample>
struct BatchScratch {
  static constexpr int kNum = kNumSums<Sample>;

  FieldLook field;
  BatchPose at;
  Stiffness stiffness;
  double of_warps[kBatchThreads / gpu::kWarpSize][kNum];
  double sums[kNum];
  std::uint32_t status;
};

// Loads the field and places the tool. All threads of the block call.
template <class Scratch>
__device__ void prepare(const BatchJob& job, int pose, Scratch& shared) {
  const int surface = surface_of(job.surface_of_pose, job.num_surfaces, job.first_pose + pose);
  const int thread = static_cast<int>(threadIdx.x);
  if (surface >= 0 && job.table != nullptr) {
    constexpr int kNumWords = sizeof(FieldLook) / sizeof(std::uint64_t);
    const auto* const from = reinterpret_cast<const std::uint64_t*>(job.table + surface);
    auto* const to = reinterpret_cast<std::uint64_t*>(&shared.field);
    for (int i = thread; i < kNumWords; i += static_cast<int>(blockDim.x)) to[i] = from[i];
  } else if (thread == 0 && surface >= 0) {
    FieldLook& field = shared.field = job.first;
    const std::ptrdiff_t pixels = surface * job.pixels_apart;
    field.pixels.planes += 2 * pixels;
    field.pixels.silhouettes += 2 * pixels;
    field.pixels.near_silhouette += pixels;
    field.tiles += surface * job.tiles_apart;
  }
  if (thread == 0 && surface >= 0) {
    const Pose* const X_WC = job.X_WC != nullptr ? job.X_WC + surface : &job.first_X_WC;
    shared.at = pose_in_camera(job.X_WT[pose], job.is_placed ? X_WC : nullptr);
  }
  __syncthreads();
  if (thread == 0) {
    StepStatus status = StepStatus::ok;
    if (surface < 0 || shared.field.grid.last_level < 0) {
      status = StepStatus::no_surface;
    } else if (!shared.at.is_finite) {
      status = StepStatus::non_finite_pose;
    } else {
      place_tool(shared.at.X_CT, job.p_TC, shared.field.frame);
    }
    shared.status = static_cast<std::uint32_t>(status);
  }
  __syncthreads();
}

// Adds the elements of this lane and folds each sum over the warp: this lane's of_warp is then sum
// number lane / 4, and its of_stiffness number `lane`.
template <class Sample, bool kHasWholes>
__device__ void add_clusters(const BatchJob& job, const FieldLook& field, double& of_warp,
                             double& of_stiffness) {
  const ElementsView& elements = job.tool.elements;
  const int num_warps = gpu::warps_per_block();
  for (int begin = gpu::warp_id(); begin < elements.num_clusters;
       begin += kClustersAtOnce * num_warps) {
    FieldShare share;
    StiffnessShare stiffness;
    NoNoise noise;
    add_clusters<Sample, kHasWholes>(elements, field, 1, false, begin, num_warps, kMaxTilesPerLane,
                                     share, &stiffness, noise);
    double values[kNumTerms] = {share.volume,   share.potential, share.force[0],  share.force[1],
                                share.force[2], share.torque[0], share.torque[1], share.torque[2]};
    fold_over_warp<kNumTerms / 2, 4>(values);
    values[0] += __shfl_xor_sync(gpu::kWholeWarp, values[0], 2);
    of_warp += values[0] + __shfl_xor_sync(gpu::kWholeWarp, values[0], 1);
    if constexpr (std::is_same_v<Sample, Curvature>) {
      double numbers[kNumStiffness] = {};
#pragma unroll
      for (int k = 0; k < StiffnessSums::kNum; ++k) numbers[k] = stiffness.numbers[k];
      fold_over_warp<kNumStiffness / 2, 1>(numbers);
      of_stiffness += numbers[0];
    }
  }
}

// Adds the sums of each warp up to those of the block.
template <class Scratch>
__device__ void add_warps(double of_warp, double of_stiffness, Scratch& shared) {
  const int lane = gpu::lane_id(), thread = static_cast<int>(threadIdx.x);
  double(&mine)[Scratch::kNum] = shared.of_warps[gpu::warp_id()];
  if (lane % 4 == 0) mine[lane / 4] = of_warp;
  if constexpr (Scratch::kNum > kNumTerms) mine[kNumTerms + lane] = of_stiffness;
  __syncthreads();
  for (int k = thread; k < Scratch::kNum; k += static_cast<int>(blockDim.x)) {
    double sum = 0;
    for (int warp = 0; warp < gpu::warps_per_block(); ++warp) sum += shared.of_warps[warp][k];
    shared.sums[k] = sum;
  }
  __syncthreads();
}

// Returns a component of a vector, in W if it `is_turned`.
__device__ inline double turned(const BatchPose& at, bool is_turned, const double* v, int axis) {
  if (!is_turned) return v[axis];
  const double(&row)[3] = at.R_WC.m[axis];
  return row[0] * v[0] + row[1] * v[1] + row[2] * v[2];
}

// Writes the stiffness of a pose; zeros if it has no measure. All threads of the block call.
template <class Scratch>
__device__ void put_stiffness(const BatchJob& job, int pose, Scratch& shared) {
  const int thread = static_cast<int>(threadIdx.x);
  if (thread == 0) {
    StiffnessSums sums;
    for (int k = 0; k < StiffnessSums::kNum; ++k) sums.numbers[k] = shared.sums[kNumTerms + k];
    shared.stiffness = sums.stiffness();
    if (job.is_placed) rotate_blocks(shared.at.R_WC, shared.stiffness.m);
  }
  __syncthreads();
  double* const to = job.out.stiffness + 36 * static_cast<std::ptrdiff_t>(pose);
  for (int i = thread; i < 36; i += static_cast<int>(blockDim.x)) {
    to[i] = shared.status == 0 ? shared.stiffness.m[i / 6][i % 6] : 0.0;
  }
}

// Number of such blocks that a multiprocessor has registers for. More of them hide more of what
// they wait for, until too many numbers do not fit in registers.
template <class Sample>
constexpr int kBlocksOf = std::is_same_v<Sample, Curvature> ? 4 : 5;

template <class Sample, bool kHasWholes>
__global__ void __launch_bounds__(kBatchThreads, kBlocksOf<Sample>)
    measure_poses(const __grid_constant__ BatchJob job) {
  using Scratch = BatchScratch<Sample>;
  auto& shared = gpu::shared_memory<Scratch>();
  const int pose = static_cast<int>(blockIdx.x), thread = static_cast<int>(threadIdx.x);
  prepare(job, pose, shared);
  double of_warp = 0, of_stiffness = 0;
  if (shared.status == 0 &&
      !is_in_front(shared.field, job.tool.whole, job.tool.largest_radius, kMaxTiles)) {
    add_clusters<Sample, kHasWholes>(job, gpu::kept(shared.field), of_warp, of_stiffness);
  }
  add_warps(of_warp, of_stiffness, shared);
  const BatchAnswers& out = job.out;
  double* const sums = shared.sums;
  // As keep_bounds.
  const double scale =
      force_scale(sums[0], sqrt(sums[2] * sums[2] + sums[3] * sums[3] + sums[4] * sums[4]));
  __syncthreads();
  for (int k = thread; k < Scratch::kNum; k += static_cast<int>(blockDim.x)) {
    sums[k] = k < 2 ? (sums[k] > 0 ? sums[k] : 0.0) : scale * sums[k];
  }
  __syncthreads();
  const std::ptrdiff_t row = 3 * static_cast<std::ptrdiff_t>(pose);
  const bool is_turned = job.is_placed && shared.status == 0;
  if (thread == 0 && out.volume != nullptr) out.volume[pose] = sums[0];
  if (thread == 1 && out.potential != nullptr) out.potential[pose] = sums[1];
  if (thread >= 2 && thread < 5 && out.force != nullptr) {
    out.force[row + thread - 2] = turned(shared.at, is_turned, sums + 2, thread - 2);
  }
  if (thread >= 5 && thread < 8 && out.torque != nullptr) {
    out.torque[row + thread - 5] = turned(shared.at, is_turned, sums + 5, thread - 5);
  }
  if (thread == 8 && out.status != nullptr) out.status[pose] = shared.status;
  if constexpr (std::is_same_v<Sample, Curvature>) put_stiffness(job, pose, shared);
}

}  // namespace
}}  // namespace palpate::v0
