// The kernel that writes the standard deviations of a batch in a scene, by the noise of its
// cameras: a block measures one pose after the other. Bodies have no noise.
#pragma once

#include "src/contact/batch/scene_kernel.cuh"
#include "src/contact/noise/put_deviations.cuh"

namespace palpate { inline namespace v0 {

// The argument of the kernel.
template <int kMaxViews>
struct SceneNoiseJob {
  SceneJob<kMaxViews> scene;
  SurfaceNoise noises[kMaxViews];  // of its cameras
  bool is_known = true;            // of all of them
  std::int32_t num_poses = 0;
  KeptRows kept;  // of the first block
};

namespace {

template <int kMaxViews>
struct SceneNoiseScratch {
  SceneScratch<kMaxViews, Gradient> scene;
  NoiseScratch<kHullWarps> noise;
};

template <int kMaxViews>
__global__ void __launch_bounds__(kHullThreads, 2)
    measure_scene_deviations(const __grid_constant__ SceneNoiseJob<kMaxViews> job) {
  auto& shared = gpu::shared_memory<SceneNoiseScratch<kMaxViews>>();
  const HullQuery<kMaxViews>& query = job.scene.query;
  const int thread = static_cast<int>(threadIdx.x);
  const KeptRows kept = job.kept.of_block(static_cast<int>(blockIdx.x));
  for (int pose = static_cast<int>(blockIdx.x); pose < job.num_poses;
       pose += static_cast<int>(gridDim.x)) {
    if (thread < kNumVariances) shared.noise.variances[thread] = 0;
    place_pose(job.scene, pose, shared.scene);
    const bool is_measured = shared.scene.status == 0;
    if (is_measured && job.is_known) {
      NoiseKeeper noise(kept, 0);
      FieldShare unused;
      StiffnessShare none;
      add_hull_elements(query, shared.scene.tool, 0, 1, true, shared.scene.views, unused, none,
                        noise);
      if (gpu::warp_id() == 0) noise.finish();
      __syncthreads();
      for (int k = 0; k < query.num_cameras; ++k) {
        const HullEye& eye = query.eyes[k];
        add_noise(kept, k, eye.field[0], eye.R_WC[0], job.noises[k], shared.noise);
      }
    }
    const Mat3d as_it_is{{{1, 0, 0}, {0, 1, 0}, {0, 0, 1}}};  // all is in W
    put_deviations(job.scene.out, pose, is_measured, job.is_known, as_it_is,
                   shared.noise.variances);
    __syncthreads();
  }
}

}  // namespace
}}  // namespace palpate::v0
