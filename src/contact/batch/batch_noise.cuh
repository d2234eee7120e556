// The kernel that writes the standard deviations of a batch by the field method: a block measures
// one pose after the other. It keeps the elements that touch, and sums up what their noise does.
#pragma once

#include "src/contact/batch/batch_kernel.cuh"
#include "src/contact/noise/put_deviations.cuh"

namespace palpate { inline namespace v0 {

// The argument of the kernel.
struct BatchNoiseJob {
  BatchJob batch;
  int num_poses = 0;
  const SurfaceNoise* table = nullptr;  // of each surface; null: the first, and others like it
  const FrameNoise* learned = nullptr;  // likewise, by the surfaces themselves
  SurfaceNoise first;
  KeptRows kept;  // of the first block
};

namespace {

constexpr int kNoiseWarps = 4, kNoiseThreads = kNoiseWarps * gpu::kWarpSize;
// Number of such blocks that a multiprocessor has registers for; see kBlocksOf.
constexpr int kNoiseBlocks = 4;

struct BatchNoiseScratch {
  FieldLook field;
  BatchPose at;
  std::uint32_t status;
  SurfaceNoise of_surface;
  NoiseScratch<kNoiseWarps> noise;
};

template <bool kHasWholes>
__global__ void __launch_bounds__(kNoiseThreads, kNoiseBlocks)
    measure_deviations(const __grid_constant__ BatchNoiseJob job) {
  auto& shared = gpu::shared_memory<BatchNoiseScratch>();
  const BatchJob& batch = job.batch;
  const ElementsView& elements = batch.tool.elements;
  const int thread = static_cast<int>(threadIdx.x);
  const KeptRows kept = job.kept.of_block(static_cast<int>(blockIdx.x));
  const float not_turned[3][3] = {{1, 0, 0}, {0, 1, 0}, {0, 0, 1}};
  for (int pose = static_cast<int>(blockIdx.x); pose < job.num_poses;
       pose += static_cast<int>(gridDim.x)) {
    prepare(batch, pose, shared);
    if (thread < kNumVariances) shared.noise.variances[thread] = 0;
    if (thread == 0 && shared.status == 0) {
      const int surface =
          surface_of(batch.surface_of_pose, batch.num_surfaces, batch.first_pose + pose);
      shared.of_surface = job.table != nullptr ? job.table[surface] : job.first;
      if (job.learned != nullptr) shared.of_surface = {job.learned[surface], 1, 1};
    }
    NoiseKeeper noise(kept, gpu::warp_id());
    if (shared.status == 0 &&
        !is_in_front(shared.field, batch.tool.whole, batch.tool.largest_radius, kMaxTiles)) {
      FieldShare unused;
      for (int begin = gpu::warp_id(); begin < elements.num_clusters;
           begin += gpu::kWarpSize * kNoiseWarps) {
        add_clusters<Gradient, kHasWholes>(elements, gpu::kept(shared.field), 1, false, begin,
                                           kNoiseWarps, kMaxTilesPerLane, unused, nullptr, noise);
      }
    }
    noise.finish();
    __syncthreads();
    if (shared.status == 0 && shared.of_surface.is_known != 0) {
      add_noise(kept, 0, shared.field, not_turned, shared.of_surface, shared.noise);
    }
    const bool is_turned = batch.is_placed && shared.status == 0;
    const Mat3d R = is_turned ? shared.at.R_WC : Mat3d{{{1, 0, 0}, {0, 1, 0}, {0, 0, 1}}};
    put_deviations(batch.out, pose, shared.status == 0, shared.of_surface.is_known != 0, R,
                   shared.noise.variances);
    __syncthreads();
  }
}

}  // namespace
}}  // namespace palpate::v0
