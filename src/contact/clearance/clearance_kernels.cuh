// Kernels of clearance on a GPU: a warp searches for the spheres of a pose as a vector of a
// processor does, with the same text (nearest_sphere.h); then a thread refines what it has found,
// and a warp asks the bodies.
#pragma once

#include "src/gpu/internal/warp_lanes.cuh"

#include "src/contact/clearance/body_distance.h"
#include "src/contact/clearance/clearance_image_cuda.cuh"
#include "src/contact/clearance/nearest_sphere.h"

namespace palpate { inline namespace v0 { namespace {

constexpr int kWarps = 4;  // of a block
/// Clearance of a pose that is known to be below the margin, m.
constexpr double kBelowAll = -1e300;

struct ToolOnGpu {
  ClusterView clusters;
  ClearanceTool tool;
};

/// The argument of the kernels of a question.
struct Question {
  const ToolOnGpu* tools = nullptr;
  const SeenByCamera* cameras = nullptr;
  const SearchedBody* bodies = nullptr;
  std::int32_t num_cameras = 0, num_surfaces = 0, num_bodies = 0;
  std::int32_t is_margin = 0;  // only whether the clearance is below the limit
  double limit = 0;
  const Pose* X_WT = nullptr;
  const std::int32_t* tool_of_pose = nullptr;  // null: the first
  std::int32_t num_poses = 0;
  ClearanceHit* hits = nullptr;
  Clearance* found = nullptr;

  __device__ const ToolOnGpu& tool(int pose) const {
    return tools[tool_of_pose != nullptr ? tool_of_pose[pose] : 0];
  }
  __device__ Pose unit_pose(int pose) const {
    return {X_WT[pose].translation, normalized(X_WT[pose].rotation)};
  }
  __device__ ClearanceJob search(const ToolOnGpu& of, const Pose& X) const {
    ClearanceJob job;
    job.spheres = of.clusters;
    job.num_cameras = num_cameras;
    job.limit = job.deepest = static_cast<float>(limit);
    return is_margin != 0 ? margin_job(job, cameras, num_cameras, of.tool, X, limit) : job;
  }
};

struct CameraScratch {
  ClearanceCamera of_warp[kWarps][kMaxCameras];
};

__global__ void __launch_bounds__(kWarps* gpu::kWarpSize)
    search_poses(const __grid_constant__ Question question) {
  auto& cameras = gpu::shared_memory<CameraScratch>().of_warp[gpu::warp_id()];
  const int pose = static_cast<int>(blockIdx.x) * kWarps + gpu::warp_id();
  if (pose >= question.num_poses) return;
  const Pose X = question.unit_pose(pose);
  if (gpu::lane_id() < question.num_cameras) {
    place_camera(question.cameras[gpu::lane_id()], X, cameras[gpu::lane_id()]);
  }
  __syncwarp();
  ClearanceJob job = question.search(question.tool(pose), X);
  job.cameras = cameras;
  ClearanceHit hit;
  isa_warp::search_clusters(job, hit);
  if (gpu::lane_id() == 0) question.hits[pose] = hit;
}

__global__ void refine_poses(const __grid_constant__ Question question) {
  const int pose = gpu::grid_thread();
  if (pose >= question.num_poses) return;
  const Pose X = question.unit_pose(pose);
  const ToolOnGpu& of = question.tool(pose);
  const ClearanceHit hit = question.num_cameras > 0 ? question.hits[pose] : ClearanceHit{};
  Clearance found;
  if (question.is_margin == 0) {
    found = clearance_of(question.cameras, of.tool, hit, X, question.limit);
  } else {
    const bool is_hit =
        is_hit_within(question.cameras, of.tool, hit, question.search(of, X), X, question.limit);
    found.value = is_hit ? kBelowAll : question.limit;
  }
  question.found[pose] = found;
}

/// Writes the nearest sphere of a tool to a body, and lowers `least` to its clearance, if that is
/// lower. The whole warp calls.
__device__ inline void ask_body(const SearchedBody& body, std::int32_t decider, const ToolOnGpu& of,
                                const Pose& X, double& least, Clearance& found) {
  const ClusterView& clusters = of.clusters;
  const PlacedTool placed(body, X);
  const int lane = gpu::lane_id();
  for (int begin = 0; begin < clusters.num_clusters; begin += gpu::kWarpSize) {
    const int mine = begin + lane;
    unsigned near =
        __ballot_sync(gpu::kWholeWarp, mine < clusters.num_clusters &&
                                           placed.may_be_below(clusters.clusters[mine], least));
    for (; near != 0; near &= near - 1) {
      const int cluster = begin + __ffs(static_cast<int>(near)) - 1;
      const std::int32_t id = clusters.sphere_id[cluster * SphereClusters::kSize + lane];
      PointDistance at;
      double value = 1e30;
      if (id >= 0) {
        at = placed.distance(of.tool.spheres[id].center);
        value = at.phi - static_cast<double>(of.tool.spheres[id].radius);
      }
      double nearest = value;
      for (int step = gpu::kWarpSize / 2; step > 0; step /= 2) {
        const double other = __shfl_xor_sync(gpu::kWholeWarp, nearest, step);
        nearest = other < nearest ? other : nearest;
      }
      if (!(nearest < least)) continue;
      least = nearest;
      const unsigned those = __ballot_sync(gpu::kWholeWarp, value == nearest);
      if (lane == __ffs(static_cast<int>(those)) - 1) {
        found = clearance_to_body(body, decider, at, of.tool, id, X);
      }
      __syncwarp();
    }
  }
}

__global__ void __launch_bounds__(kWarps* gpu::kWarpSize)
    search_bodies(const __grid_constant__ Question question) {
  const int pose = static_cast<int>(blockIdx.x) * kWarps + gpu::warp_id();
  if (pose >= question.num_poses) return;
  const Pose X = question.unit_pose(pose);
  const ToolOnGpu& of = question.tool(pose);
  double least = question.found[pose].value;
  for (int b = 0; b < question.num_bodies; ++b) {
    if (question.is_margin != 0 && least < question.limit) return;
    ask_body(question.bodies[b], question.num_surfaces + b, of, X, least, question.found[pose]);
  }
  if (gpu::lane_id() == 0 && question.is_margin == 0 && least <= -question.limit) {
    question.found[pose] = Clearance{-question.limit};
  }
}

}}}  // namespace palpate::v0
