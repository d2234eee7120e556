// Clearance on a GPU: a warp searches for the spheres of a pose as a vector of a processor does,
// with the same text (nearest_sphere.h); then a thread refines what it has found, and a warp asks
// the bodies.
#include "src/gpu/internal/warp_lanes.cuh"

#include <algorithm>
#include <optional>
#include <utility>

#include "src/contact/bodies/shapes_of_scene.h"
#include "src/contact/clearance/clearance_batch.h"
#include "src/contact/clearance/clearance_image_cuda.cuh"
#include "src/contact/clearance/nearest_sphere.h"
#include "src/contact/cuda/gpu_field.h"
#include "src/contact/index/tool_parts.h"

namespace palpate { inline namespace v0 {
namespace {

constexpr int kWarps = 4;  // of a block
/// Poses on the GPU at a time.
constexpr std::size_t kAtOnce = 1 << 16;

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
    found.value = is_hit ? question.limit - 1 : question.limit;
  }
  question.found[pose] = found;
}

__global__ void __launch_bounds__(kWarps* gpu::kWarpSize)
    search_bodies(const __grid_constant__ Question question) {
  const int pose = static_cast<int>(blockIdx.x) * kWarps + gpu::warp_id(), lane = gpu::lane_id();
  if (pose >= question.num_poses) return;
  const Pose X = question.unit_pose(pose);
  const ToolOnGpu& of = question.tool(pose);
  const ClusterView& clusters = of.clusters;
  double least = question.found[pose].value;
  for (int b = 0; b < question.num_bodies; ++b) {
    if (question.is_margin != 0 && least < question.limit) return;
    const SearchedBody& body = question.bodies[b];
    const PlacedTool placed(body, X);
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
          question.found[pose] =
              clearance_to_body(body, question.num_surfaces + b, at, of.tool, id, X);
        }
        __syncwarp();
      }
    }
  }
  if (lane == 0 && question.is_margin == 0 && least <= -question.limit) {
    question.found[pose] = Clearance{-question.limit};
  }
}

class ClearanceBatchCuda final : public ClearanceBatch {
 public:
  ClearanceBatchCuda(std::span<const std::shared_ptr<const ToolIndex>> tools, int gpu)
      : gpu_(gpu), memory_(gpu), stream_(gpu, gpu::Priority::low) {
    std::vector<ToolOnGpu> made;
    for (const auto& index : tools) {
      const SphereClusters& from = parts_of(*index).clusters();
      made.push_back({view_of(from), clearance_tool(index->tool())});
      ToolOnGpu& to = made.back();
      ClusterView& c = to.clusters;
      c.x = memory_.copy_of(from.x);
      c.y = memory_.copy_of(from.y);
      c.z = memory_.copy_of(from.z);
      c.radius = memory_.copy_of(from.radius);
      c.sphere_id = memory_.copy_of(from.sphere_id);
      c.clusters = memory_.copy_of(from.clusters);
      c.groups = memory_.copy_of(from.groups);
      to.tool.spheres = memory_.copy_of(index->tool().spheres());
    }
    question_.tools = memory_.copy_of(made);
    cameras_ = memory_.take<SeenByCamera>(kMaxCameras);
    X_WT_ = memory_.take<Pose>(kAtOnce);
    tool_of_pose_ = memory_.take<std::int32_t>(kAtOnce);
    question_.hits = memory_.take<ClearanceHit>(kAtOnce);
    question_.found = memory_.take<Clearance>(kAtOnce);
    found_ = memory_.take_pinned<Clearance>(kAtOnce);
  }

  const Status& status() const { return memory_.status() ? stream_.status() : memory_.status(); }

  Status take(std::span<const SurfaceView> surfaces, std::span<const Body> bodies) override {
    if (const Status status = check_searched(surfaces, gpu_); !status) return status;
    const std::size_t num = 2 * surfaces.size();
    while (images_.size() < num) images_.push_back(std::make_unique<ImageOnGpu>(gpu_));
    std::vector<const ClearanceImage*> images(num);
    for (std::size_t i = 0; i < num; ++i) {
      const auto [view, is_blocked] = images_of(surfaces[i / 2], surfaces.size() == 1)[i % 2];
      if (view == nullptr) continue;
      images_[i]->update(*view, is_blocked, stream_);
      images[i] = &images_[i]->image();
    }
    seen_ = seen_by(surfaces, images);
    question_.cameras = cameras_;
    question_.num_cameras = static_cast<std::int32_t>(seen_.size());
    question_.num_surfaces = static_cast<std::int32_t>(surfaces.size());
    stream_.copy(cameras_, seen_.data(), seen_.size() * sizeof(SeenByCamera));
    if (const Status status = take_bodies(bodies); !status) return status;
    return stream_.wait();
  }

  Status measure(const ScenePoses& poses, const ClearanceWants& wants, const Put& put) override {
    if (wants.smoothing > 0) {
      return Error{Errc::unavailable,
                   "a smooth minimum of the clearance is computed on the CPU; create the contact "
                   "with Place::cpu(), or leave clearance_smoothing out"};
    }
    return evaluate(poses, wants.limit, false, put);
  }

  Status any(const ScenePoses& poses, double margin, std::uint8_t* hits) override {
    std::fill_n(hits, num_groups_of(poses), std::uint8_t{0});
    for (std::size_t i = 0; i < poses.X_WT.size(); ++i) {
      if (!is_finite(poses.X_WT[i])) hits[group_of(poses, i)] = 1;
    }
    return evaluate(poses, margin, true, [&](std::size_t i, const Clearance& at) {
      if (at.value < margin) hits[group_of(poses, i)] = 1;
    });
  }

 private:
  Status take_bodies(std::span<const Body> bodies) {
    const Status status = shapes_.take(
        bodies.size(), [&](std::size_t b) -> const auto& { return bodies[b].placed().shape; },
        [this](const auto& shape) -> Result<FieldOnGpu> {
          FieldOnGpu made{gpu::Memory(gpu_)};
          made.values = made.memory->copy_of(parts_of(*shape).solid_field().values());
          if (!made.memory->status()) return made.memory->status().error();
          return Result<FieldOnGpu>(std::move(made));  // nvcc copies what is named
        });
    question_.num_bodies = 0;
    if (!status) return status;
    if (bodies.empty()) return Done{};
    std::vector<SearchedBody> desired;
    for (std::size_t b = 0; b < bodies.size(); ++b) {
      desired.push_back(searched_body(bodies[b]));
      desired.back().field.values = shapes_.of_body(b).values;
    }
    if (desired.size() > num_bodies_) {
      gpu::Memory memory(gpu_);
      bodies_on_gpu_ = memory.take<SearchedBody>(desired.size());
      if (!memory.status()) return memory.status();
      num_bodies_ = desired.size();
      bodies_.emplace(std::move(memory));
    }
    bodies_there_ = std::move(desired);
    stream_.copy(bodies_on_gpu_, bodies_there_.data(), bodies_there_.size() * sizeof(SearchedBody));
    question_.bodies = bodies_on_gpu_;
    question_.num_bodies = static_cast<std::int32_t>(bodies.size());
    return Done{};
  }

  Status evaluate(const ScenePoses& poses, double limit, bool is_margin, const Put& put) {
    Question question = question_;
    question.limit = limit;
    question.is_margin = is_margin ? 1 : 0;
    question.X_WT = X_WT_;
    std::vector<Pose> finite(poses.X_WT.begin(), poses.X_WT.end());
    for (Pose& X_WT : finite) {
      if (!is_finite(X_WT)) X_WT = {};
    }
    for (std::size_t first = 0; first < finite.size(); first += kAtOnce) {
      const std::size_t num = std::min(kAtOnce, finite.size() - first);
      stream_.copy(X_WT_, finite.data() + first, num * sizeof(Pose));
      if (!poses.tool_of_pose.empty()) {
        stream_.copy(tool_of_pose_, poses.tool_of_pose.data() + first, num * sizeof(std::int32_t));
        question.tool_of_pose = tool_of_pose_;
      }
      question.num_poses = static_cast<std::int32_t>(num);
      const gpu::LaunchShape warps{.blocks = blocks_for(num, kWarps),
                                   .threads = kWarps * gpu::kWarpSize,
                                   .shared_bytes = sizeof(CameraScratch)};
      if (question.num_cameras > 0) gpu::launch(stream_, warps, search_poses, question);
      gpu::launch(stream_, {.blocks = blocks_for(num, kThreads)}, refine_poses, question);
      if (question.num_bodies > 0) gpu::launch(stream_, warps, search_bodies, question);
      stream_.copy(found_, question.found, num * sizeof(Clearance));
      if (!stream_.wait(60)) return stream_.status();
      for (std::size_t i = 0; i < num; ++i) {
        if (is_finite(poses.X_WT[first + i])) put(first + i, found_[i]);
      }
    }
    return stream_.status();
  }

  // The distance field of a shape.
  struct FieldOnGpu {
    std::optional<gpu::Memory> memory;
    const float* values = nullptr;
  };

  int gpu_;
  gpu::Memory memory_;
  gpu::Stream stream_;
  ShapesOfScene<FieldOnGpu> shapes_;
  std::optional<gpu::Memory> bodies_;
  std::size_t num_bodies_ = 0;  // there is room for
  SearchedBody* bodies_on_gpu_ = nullptr;
  std::vector<SearchedBody> bodies_there_;
  std::vector<std::unique_ptr<ImageOnGpu>> images_;  // two of each surface
  std::vector<SeenByCamera> seen_;
  SeenByCamera* cameras_ = nullptr;
  Pose* X_WT_ = nullptr;
  std::int32_t* tool_of_pose_ = nullptr;
  Clearance* found_ = nullptr;  // in host memory
  Question question_;
};

}  // namespace

Result<std::unique_ptr<ClearanceBatch>> make_clearance_batch_cuda(
    std::span<const std::shared_ptr<const ToolIndex>> tools, const ExecutionOptions& execution) {
  if (const Status status = gpu::check_gpu(execution.gpu); !status) return status.error();
  auto made = std::make_unique<ClearanceBatchCuda>(tools, execution.gpu);
  if (const Status status = made->status(); !status) return status.error();
  return std::unique_ptr<ClearanceBatch>(std::move(made));
}

}}  // namespace palpate::v0
