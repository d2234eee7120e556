// Clearance on a GPU: images, bodies and tools of a scene there, and questions about many poses.
#include "src/contact/clearance/clearance_kernels.cuh"

#include <algorithm>
#include <optional>
#include <string>
#include <utility>

#include "src/contact/bodies/shapes_of_scene.h"
#include "src/contact/clearance/clearance_batch.h"
#include "src/contact/clearance/tree_clearance.cuh"
#include "src/contact/cuda/gpu_field.h"
#include "src/contact/index/tool_parts.h"

namespace palpate { inline namespace v0 {
namespace {

/// Poses in a launch.
constexpr std::size_t kAtOnce = 1 << 15;

class ClearanceBatchCuda final : public ClearanceBatch {
 public:
  ClearanceBatchCuda(std::span<const std::shared_ptr<const ToolIndex>> tools, int gpu)
      : gpu_(gpu),
        memory_(gpu),
        stream_(gpu, gpu::Priority::low),
        launches_{Launch(gpu), Launch(gpu)} {
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
    for (Launch& launch : launches_) {
      launch.X_WT = memory_.take<Pose>(kAtOnce);
      launch.tool_of_pose = memory_.take<std::int32_t>(kAtOnce);
      launch.hits = memory_.take<ClearanceHit>(kAtOnce);
      launch.found = memory_.take<Clearance>(kAtOnce);
      launch.found_here = memory_.take_pinned<Clearance>(kAtOnce);
    }
  }

  const Status& status() const {
    for (const Launch& launch : launches_) {
      if (!launch.stream.status()) return launch.stream.status();
    }
    return memory_.status() ? stream_.status() : memory_.status();
  }

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

  Result<std::optional<RefusedPosition>> measure_tree(const JointPoses& poses,
                                                      const TreeAnswers& answers) override {
    if (poses.gpu != kHostMemory && poses.gpu != gpu_) {
      return Error{Errc::invalid_argument,
                   "positions of joints in the memory of GPU " + std::to_string(poses.gpu) +
                       " were given to a contact on GPU " + std::to_string(gpu_) +
                       "; give them there, or in host memory"};
    }
    if (!tree_ || tree_->tree() != poses.tree) tree_.emplace(poses.tree, gpu_);
    if (const Status status = tree_->status(); !status) {
      tree_.reset();
      return status.error();
    }
    const auto refused = tree_->measure(question_, poses, answers, stream_);
    if (!stream_.status()) return stream_.status().error();
    return refused;
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

  // Some of the poses on the GPU. Two take turns: while it measures one, the results of the other
  // are put where they belong.
  struct Launch {
    explicit Launch(int gpu) : stream(gpu, gpu::Priority::low) {}

    gpu::Stream stream;
    Pose* X_WT = nullptr;
    std::int32_t* tool_of_pose = nullptr;
    ClearanceHit* hits = nullptr;
    Clearance *found = nullptr, *found_here = nullptr;  // the latter in host memory
    std::size_t first = 0, num = 0;
  };

  Status evaluate(const ScenePoses& poses, double limit, bool is_margin, const Put& put) {
    finite_.assign(poses.X_WT.begin(), poses.X_WT.end());
    for (Pose& X_WT : finite_) {
      if (!is_finite(X_WT)) X_WT = {};
    }
    Question question = question_;
    question.limit = limit;
    question.is_margin = is_margin ? 1 : 0;
    for (Launch& launch : launches_) launch.num = 0;
    int turn = 0;
    for (std::size_t first = 0; first < finite_.size(); first += kAtOnce, turn = 1 - turn) {
      Launch& launch = launches_[turn];
      if (const Status status = finish(launch, poses, put); !status) return status;
      launch.first = first;
      launch.num = std::min(kAtOnce, finite_.size() - first);
      enqueue(launch, finite_.data() + first, poses.tool_of_pose, question);
    }
    for (int i = 0; i < 2; ++i, turn = 1 - turn) {
      if (const Status status = finish(launches_[turn], poses, put); !status) return status;
    }
    return Done{};
  }

  void enqueue(Launch& launch, const Pose* X_WT, std::span<const std::int32_t> tool_of_pose,
               Question question) {
    gpu::Stream& stream = launch.stream;
    stream.copy(launch.X_WT, X_WT, launch.num * sizeof(Pose));
    if (!tool_of_pose.empty()) {
      stream.copy(launch.tool_of_pose, tool_of_pose.data() + launch.first,
                  launch.num * sizeof(std::int32_t));
      question.tool_of_pose = launch.tool_of_pose;
    }
    question.X_WT = launch.X_WT;
    question.hits = launch.hits;
    question.found = launch.found;
    question.num_poses = static_cast<std::int32_t>(launch.num);
    const gpu::LaunchShape warps{.blocks = blocks_for(launch.num, kWarps),
                                 .threads = kWarps * gpu::kWarpSize,
                                 .shared_bytes = sizeof(CameraScratch)};
    if (question.num_cameras > 0) gpu::launch(stream, warps, search_poses, question);
    gpu::launch(stream, {.blocks = blocks_for(launch.num, kThreads)}, refine_poses, question);
    if (question.num_bodies > 0) gpu::launch(stream, warps, search_bodies, question);
    stream.copy(launch.found_here, launch.found, launch.num * sizeof(Clearance));
  }

  static Status finish(Launch& launch, const ScenePoses& poses, const Put& put) {
    const std::size_t num = std::exchange(launch.num, 0);
    if (num == 0) return Done{};
    if (const Status status = launch.stream.wait(60); !status) return status;
    for (std::size_t i = 0; i < num; ++i) {
      if (is_finite(poses.X_WT[launch.first + i])) put(launch.first + i, launch.found_here[i]);
    }
    return Done{};
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
  std::vector<Pose> finite_;  // outlives what copies it
  Launch launches_[2];
  Question question_;
  std::optional<TreeOnGpu> tree_;  // the last one
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
