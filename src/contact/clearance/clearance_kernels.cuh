// Kernels of clearance on a GPU: a warp searches for the spheres of a pose as a vector of a
// processor does, with the same text (nearest_sphere.h); then a thread refines what it has found
// and writes the answers. With bodies, or for a smooth minimum, a warp asks them before these are
// written.
#pragma once

#include "src/gpu/internal/warp_lanes.cuh"

#include "src/contact/clearance/body_distance.h"
#include "src/contact/clearance/clearance_batch.h"
#include "src/contact/clearance/clearance_image_cuda.cuh"
#include "src/contact/clearance/nearest_sphere.h"

namespace palpate { inline namespace v0 { namespace {

// Warps of a block that search. One: poses take very different times, and the place of a block is
// free only when all of its warps are done.
constexpr int kWarpsThatSearch = 1;
// Blocks that search on a multiprocessor: of 64 registers a thread, where it holds so many blocks
// (compute capability 8.0, 9.0, 10.0 and 10.3). Elsewhere there are fewer, with more registers.
#if defined(__CUDA_ARCH__) && (__CUDA_ARCH__ == 800 || __CUDA_ARCH__ == 900 || \
                               __CUDA_ARCH__ == 1000 || __CUDA_ARCH__ == 1030)
constexpr int kBlocksThatSearch = 32 / kWarpsThatSearch;
#else
constexpr int kBlocksThatSearch = 1;
#endif
// Warps of a block that ask bodies, and of one that adds up a smooth minimum.
constexpr int kWarpsAtBodies = 4, kWarpsThatSoften = 4;
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
  double limit = 0, smoothing = 0;
  const Pose* X_WT = nullptr;
  const std::int32_t* tool_of_pose = nullptr;  // null: the first
  std::int32_t num_poses = 0;
  ClearanceCamera* placed = nullptr;  // num_cameras of each pose
  std::uint8_t* is_near = nullptr;    // of poses that anything may be near to
  ClearanceHit* hits = nullptr;
  Clearance* found = nullptr;
  ClearanceHit* each = nullptr;                 // of all spheres of a pose, for a smooth minimum
  std::int32_t max_spheres = 0;                 // of a tool
  SceneAnswers out;                             // the clearance
  std::uint8_t* is_within = nullptr;            // of poses, or groups; of a margin
  const std::int32_t* group_of_pose = nullptr;  // null: of poses

  /// True if nothing comes after the planes: their clearance is the answer.
  PALPATE_HOSTDEV bool is_refined_last() const { return num_bodies == 0 && !(smoothing > 0); }
  __device__ const ToolOnGpu& tool(int pose) const {
    return tools[tool_of_pose != nullptr ? tool_of_pose[pose] : 0];
  }
  __device__ bool is_measured(int pose) const {
    const Vec3d& t = X_WT[pose].translation;
    const Quaternion& q = X_WT[pose].rotation;
    const double sum = t.x + t.y + t.z + q.x + q.y + q.z + q.w;
    return sum - sum == 0;  // as is_finite(Pose)
  }
  __device__ Pose unit_pose(int pose) const {
    return {X_WT[pose].translation, normalized(X_WT[pose].rotation)};
  }
  /// The tool of a pose before all cameras.
  __device__ ClearanceCamera* cameras_of(int pose) const {
    return placed + std::ptrdiff_t{num_cameras} * pose;
  }
  __device__ ClearanceJob search(const ToolOnGpu& of, const Pose& X) const {
    ClearanceJob job;
    job.spheres = of.clusters;
    job.num_cameras = num_cameras;
    job.limit = job.deepest = static_cast<float>(limit);
    return is_margin != 0 ? margin_job(job, cameras, num_cameras, of.tool, X, limit) : job;
  }
};

/// Answers of a question, and whose memory they are in.
struct PoseAnswers {
  SceneAnswers clearance;
  std::uint8_t* is_within = nullptr;
  int gpu = kHostMemory;
};

/// Some of the poses on the GPU.
struct Launch {
  explicit Launch(int gpu) : stream(gpu, gpu::Priority::low) {}

  gpu::Stream stream;
  Pose* X_WT = nullptr;
  std::int32_t *tool_of_pose = nullptr, *group_of_pose = nullptr;
  // See Question.
  ClearanceCamera* placed = nullptr;
  std::uint8_t* is_near = nullptr;
  ClearanceHit* hits = nullptr;
  Clearance* found = nullptr;
  ClearanceHit* each = nullptr;
  PoseAnswers staged;
  std::size_t first = 0, num = 0;
};

/// Returns the shape of a launch with a warp for each pose, so many to a block.
inline gpu::LaunchShape warps_for(std::size_t num_poses, int of_block) {
  return {.blocks = blocks_for(num_poses, of_block), .threads = of_block * gpu::kWarpSize};
}

/// Calls f(array of the caller, staged one, numbers of a pose, array of the question).
template <class F>
void for_answers(const PoseAnswers& answers, const PoseAnswers& staged, Question& question,
                 const F& f) {
  const SceneAnswers &to = answers.clearance, &from = staged.clearance;
  f(to.clearance, from.clearance, std::size_t{1}, question.out.clearance);
  f(to.nearest, from.nearest, std::size_t{1}, question.out.nearest);
  f(to.decided, from.decided, std::size_t{1}, question.out.decided);
  f(to.clearance_gradient, from.clearance_gradient, std::size_t{6},
    question.out.clearance_gradient);
  f(answers.is_within, staged.is_within, std::size_t{1}, question.is_within);
}

/// Returns a number (m) that no sphere of a ball is clear by less than, at most `limit`.
__device__ inline float clear_before(const ClearanceCamera& camera, const Cluster& ball,
                                     float limit) {
  const auto row = [&](int k) {
    const float(&r)[3] = camera.R_CT[k];
    return isa_warp::splat(r[0] * ball.center.x + r[1] * ball.center.y + r[2] * ball.center.z +
                           camera.p_CT[k]);
  };
  return isa_warp::bound_around(*camera.field, {row(0), row(1), row(2)},
                                isa_warp::splat(ball.reach), isa_warp::splat(limit))
      .v;
}

/// Places the tools before all cameras, and asks whether anything may be near to the balls around
/// them: a thread takes a pose.
__global__ void place_poses(const __grid_constant__ Question question) {
  const int pose = gpu::grid_thread();
  if (pose >= question.num_poses) return;
  bool is_near = false;
  if (question.is_measured(pose)) {
    const Pose X = question.unit_pose(pose);
    const ToolOnGpu& of = question.tool(pose);
    const float limit = question.search(of, X).limit;
    for (int k = 0; k < question.num_cameras; ++k) {
      ClearanceCamera camera;
      place_camera(question.cameras[k], X, camera);
      question.cameras_of(pose)[k] = camera;
      is_near = is_near || camera.seen_free != nullptr ||
                clear_before(camera, of.tool.ball, limit) < limit;
    }
  }
  question.is_near[pose] = is_near ? 1 : 0;
  question.hits[pose] = {};
}

__global__ void __launch_bounds__(kWarpsThatSearch* gpu::kWarpSize, kBlocksThatSearch)
    search_poses(const __grid_constant__ Question question) {
  const int pose = static_cast<int>(blockIdx.x) * kWarpsThatSearch + gpu::warp_id();
  if (pose >= question.num_poses || question.is_near[pose] == 0) return;
  ClearanceJob job = question.search(question.tool(pose), question.unit_pose(pose));
  job.cameras = question.cameras_of(pose);
  ClearanceHit hit;
  isa_warp::search_clusters(job, hit);
  if (gpu::lane_id() == 0) question.hits[pose] = hit;
}

/// Writes the answer of a pose.
__device__ inline void put_pose(const Question& question, int pose, const Clearance& found) {
  const bool is_measured = question.is_measured(pose);
  if (question.is_margin == 0) {
    return put_clearance(static_cast<std::size_t>(pose), is_measured ? found : Clearance{},
                         question.out);
  }
  const bool is_hit = !is_measured || found.value < question.limit;
  if (question.group_of_pose == nullptr) {
    question.is_within[pose] = is_hit ? 1 : 0;
  } else if (is_hit) {
    question.is_within[question.group_of_pose[pose]] = 1;
  }
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
  if (question.is_refined_last()) return put_pose(question, pose, found);
  question.found[pose] = found;
}

/// Calls visit(id, at) for clusters of spheres that a body may be nearer to than `least` (m), which
/// may be lowered meanwhile: in each lane a sphere, or -1, and its distance. The whole warp calls.
template <class Visit>
__device__ void for_clusters_near(const SearchedBody& body, const ToolOnGpu& of, const Pose& X,
                                  const double& least, const Visit& visit) {
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
      visit(id, id >= 0 ? placed.distance(of.tool.spheres[id].center) : PointDistance{});
    }
  }
}

/// Writes the nearest sphere of a tool to a body, and lowers `least` to its clearance, if that is
/// lower. The whole warp calls.
__device__ inline void ask_body(const SearchedBody& body, std::int32_t decider, const ToolOnGpu& of,
                                const Pose& X, double& least, Clearance& found) {
  for_clusters_near(body, of, X, least, [&](std::int32_t id, const PointDistance& at) {
    const double value = id >= 0 ? at.phi - static_cast<double>(of.tool.spheres[id].radius) : 1e30;
    double nearest = value;
    for (int step = gpu::kWarpSize / 2; step > 0; step /= 2) {
      const double other = __shfl_xor_sync(gpu::kWholeWarp, nearest, step);
      nearest = other < nearest ? other : nearest;
    }
    if (!(nearest < least)) return;
    least = nearest;
    const unsigned those = __ballot_sync(gpu::kWholeWarp, value == nearest);
    if (gpu::lane_id() == __ffs(static_cast<int>(those)) - 1) {
      found = clearance_to_body(body, decider, at, of.tool, id, X);
    }
    __syncwarp();
  });
}

__global__ void __launch_bounds__(kWarpsAtBodies* gpu::kWarpSize)
    search_bodies(const __grid_constant__ Question question) {
  const int pose = static_cast<int>(blockIdx.x) * kWarpsAtBodies + gpu::warp_id();
  if (pose >= question.num_poses || !question.is_measured(pose)) return;
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

/// Puts the smooth minimum in place of the least clearance: a lane has some of the spheres.
__global__ void __launch_bounds__(kWarpsThatSoften* gpu::kWarpSize)
    soften_poses(const __grid_constant__ Question question) {
  const int pose = static_cast<int>(blockIdx.x) * kWarpsThatSoften + gpu::warp_id();
  if (pose >= question.num_poses || !question.is_measured(pose)) return;
  Clearance& found = question.found[pose];
  if (found.sphere < 0) return;
  const Pose X = question.unit_pose(pose);
  const ToolOnGpu& of = question.tool(pose);
  const int lane = gpu::lane_id();
  SoftMinimum soft(found.value, question.limit, question.smoothing);
  if (lane > 0) soft.sum = 0;
  if (question.num_cameras > 0) {
    ClearanceJob job = question.search(of, X);
    job = margin_job(job, question.cameras, question.num_cameras, of.tool, X, soft.reach);
    job.enough = -1e9f;
    job.deepest = static_cast<float>(question.limit);
    job.cameras = question.cameras_of(pose);
    job.each = question.each + std::ptrdiff_t{question.max_spheres} * pose;
    const int num = of.clusters.num_spheres;
    for (int i = lane; i < num; i += gpu::kWarpSize) job.each[i] = {job.limit};
    __syncwarp();
    ClearanceHit none;
    isa_warp::search_clusters(job, none);
    __syncwarp();
    for (int i = lane; i < num; i += gpu::kWarpSize) {
      soft.add(clearance_of(question.cameras, of.tool, job.each[i], X, question.limit));
    }
  }
  for (int b = 0; b < question.num_bodies; ++b) {
    const SearchedBody& body = question.bodies[b];
    for_clusters_near(body, of, X, soft.reach, [&](std::int32_t id, const PointDistance& at) {
      if (id >= 0) soft.add(clearance_to_body(body, 0, at, of.tool, id, X));
    });
  }
  soft.sum = gpu::warp_sum(soft.sum);
  for (double& slope : soft.gradient) slope = gpu::warp_sum(slope);
  if (lane == 0) soft.put(found);
}

__global__ void put_poses(const __grid_constant__ Question question) {
  const int pose = gpu::grid_thread();
  if (pose < question.num_poses) put_pose(question, pose, question.found[pose]);
}

}}}  // namespace palpate::v0
