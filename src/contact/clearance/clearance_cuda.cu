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
#include "src/contact/hull/camera_seats.h"
#include "src/contact/index/tool_parts.h"

namespace palpate { inline namespace v0 {
namespace {

/// Launches whose poses and answers are all on the GPU have so many times more poses: they take no
/// turns, so that what their last warps take counts.
constexpr std::size_t kMoreThere = 4;

class ClearanceBatchCuda final : public ClearanceBatch {
 public:
  ClearanceBatchCuda(std::span<const std::shared_ptr<const ToolIndex>> tools, int gpu,
                     std::size_t at_once)
      : gpu_(gpu),
        at_once_(at_once),
        memory_(gpu),
        stream_(gpu, gpu::Priority::low),
        caller_stream_(gpu),
        launches_{Launch(gpu), Launch(gpu), Launch(gpu)} {
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
      question_.max_spheres = std::max(question_.max_spheres, c.num_spheres);
    }
    question_.tools = memory_.copy_of(made);
    cameras_ = memory_.take<SeenByCamera>(kMaxCameras);
    for (Launch& launch : launches_) {
      launch.X_WT = memory_.take<Pose>(at_once);
      launch.tool_of_pose = memory_.take<std::int32_t>(at_once);
      launch.group_of_pose = memory_.take<std::int32_t>(at_once);
      const std::size_t most = &launch == &launches_[2] ? kMoreThere * at_once : at_once;
      launch.hits = memory_.take<ClearanceHit>(most);
      launch.found = memory_.take<Clearance>(most);
      launch.is_near = memory_.take<std::uint8_t>(most);
      SceneAnswers& staged = launch.staged.clearance;
      staged.clearance = memory_.take<double>(at_once);
      staged.nearest = memory_.take<std::int32_t>(at_once);
      staged.decided = memory_.take<std::int32_t>(at_once);
      staged.clearance_gradient = memory_.take<double>(6 * at_once);
      launch.staged.is_within = memory_.take<std::uint8_t>(at_once);
    }
  }

  const Status& status() const {
    for (const Launch& launch : launches_) {
      if (!launch.stream.status()) return launch.stream.status();
    }
    return memory_.status() ? stream_.status() : memory_.status();
  }

  Status take(std::span<const SurfaceView> surfaces, std::span<const Body> bodies,
              std::optional<CallerStream> desired) override {
    if (const Status status = check_searched(surfaces, gpu_); !status) return status;
    if (is_last(surfaces, bodies)) return Done{};
    gpu::Stream& stream = desired ? caller_stream(*desired) : stream_;
    if (stream.is_recording()) {
      return Error{Errc::invalid_argument,
                   "a scene was captured in a graph before it was asked; ask it once before, with "
                   "the same tools"};
    }
    is_known_ = false;
    if (!desired) caller_stream_.continue_in(stream.handle());
    if (const Status& waited = stream.wait(60); !waited) return waited;  // for the last scene
    const std::size_t num = 2 * surfaces.size();
    while (images_.size() < num) images_.push_back(std::make_unique<ImageOnGpu>(gpu_));
    std::vector<const ClearanceImage*> images(num);
    for (std::size_t i = 0; i < num; ++i) {
      const auto [view, is_blocked] = images_of(surfaces[i / 2], surfaces.size() == 1)[i % 2];
      if (view == nullptr) continue;
      if (!images_[i]->is_of(*view)) images_[i]->update(*view, is_blocked, stream);
      images[i] = &images_[i]->image();
    }
    seen_ = seen_by(surfaces, images);
    if (const Status status = take_places(seen_.size()); !status) return status;
    question_.cameras = cameras_;
    question_.num_cameras = static_cast<std::int32_t>(seen_.size());
    question_.num_surfaces = static_cast<std::int32_t>(surfaces.size());
    stream.copy(cameras_, seen_.data(), seen_.size() * sizeof(SeenByCamera));
    if (const Status status = take_bodies(bodies, stream); !status) return status;
    if (const Status& status = stream.wait(); !status) return status;
    keep(surfaces, bodies);
    return Done{};
  }

  Status measure(const ScenePoses& poses, const SceneAnswers& answers,
                 std::optional<CallerStream> stream) override {
    Question question = question_;
    question.limit = answers.clearance_limit;
    question.smoothing = answers.clearance_smoothing;
    if (question.smoothing > 0 && !hits_of_spheres_) {
      if (stream && caller_stream(*stream).is_recording()) {
        return Error{Errc::invalid_argument,
                     "a smooth minimum was captured in a graph before its memory was there; ask "
                     "for it once before"};
      }
      if (const Status status = take_hits_of_spheres(); !status) return status;
    }
    return evaluate(poses, {answers, nullptr, answers.contact.gpu}, question, stream);
  }

  Status any(const ScenePoses& poses, double margin, std::uint8_t* hits,
             std::optional<CallerStream> stream) override {
    Question question = question_;
    question.limit = margin;
    question.is_margin = 1;
    return evaluate(poses, {{}, hits, poses.gpu}, question, stream);
  }

  Result<std::optional<RefusedPosition>> measure_tree(const JointPoses& poses,
                                                      const TreeAnswers& answers) override {
    if (poses.gpu != kHostMemory && poses.gpu != gpu_) {
      return Error{Errc::invalid_argument,
                   "positions of joints in the memory of GPU " + std::to_string(poses.gpu) +
                       " were given to a contact on GPU " + std::to_string(gpu_) +
                       "; give them there, or in host memory"};
    }
    if (!tree_ || tree_->tree() != poses.tree) tree_.emplace(poses.tree, gpu_, 2 * at_once_);
    if (const Status status = tree_->status(); !status) {
      tree_.reset();
      return status.error();
    }
    const auto refused = tree_->measure(question_, poses, answers, stream_);
    if (!stream_.status()) return stream_.status().error();
    return refused;
  }

 private:
  /// Takes memory for the hits of all spheres, of as many poses at a time as fit.
  Status take_hits_of_spheres() {
    constexpr std::size_t kBytes = 32u << 20;
    const std::size_t each = static_cast<std::size_t>(question_.max_spheres);
    soft_at_once_ = std::clamp<std::size_t>(kBytes / (each * sizeof(ClearanceHit)), 1, at_once_);
    gpu::Memory memory(gpu_);
    for (Launch& launch : launches_) {
      launch.each = memory.take<ClearanceHit>(soft_at_once_ * each);
    }
    if (!memory.status()) return memory.status();
    hits_of_spheres_.emplace(std::move(memory));
    return Done{};
  }

  /// Takes memory for the tools of a launch before so many cameras.
  Status take_places(std::size_t num) {
    if (num <= num_placed_) return Done{};
    num_placed_ = 0;
    gpu::Memory memory(gpu_);
    for (Launch& launch : launches_) {
      const std::size_t more = &launch == &launches_[2] ? std::max(num, kMoreThere) : num;
      launch.placed = memory.take<ClearanceCamera>(more * at_once_);
    }
    if (!memory.status()) return memory.status();
    places_.emplace(std::move(memory));
    num_placed_ = num;
    return Done{};
  }

  gpu::Stream& caller_stream(const CallerStream& desired) {
    caller_stream_.continue_in(desired.handle);
    return caller_stream_;
  }

  bool is_last(std::span<const SurfaceView> surfaces, std::span<const Body> bodies) const {
    const auto is_body = [](const PlacedBody& known, const Body& given) {
      return known.shape == given.placed().shape && known.X_WB == given.placed().X_WB;
    };
    return is_known_ && show_same(known_surfaces_, surfaces) &&
           std::ranges::equal(known_bodies_, bodies, is_body);
  }
  void keep(std::span<const SurfaceView> surfaces, std::span<const Body> bodies) {
    known_surfaces_.assign(surfaces.begin(), surfaces.end());
    known_bodies_.clear();
    for (const Body& body : bodies) known_bodies_.push_back(body.placed());
    is_known_ = true;
  }

  Status take_bodies(std::span<const Body> bodies, gpu::Stream& stream) {
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
    stream.copy(bodies_on_gpu_, bodies_there_.data(), bodies_there_.size() * sizeof(SearchedBody));
    question_.bodies = bodies_on_gpu_;
    question_.num_bodies = static_cast<std::int32_t>(bodies.size());
    return Done{};
  }

  /// Asks for all poses, those of a launch at a time.
  Status evaluate(const ScenePoses& poses, const PoseAnswers& to, const Question& question,
                  std::optional<CallerStream> desired) {
    gpu::Stream* const given = desired ? &caller_stream(*desired) : nullptr;
    const bool is_staged = to.gpu == kHostMemory, has_groups = !poses.group_of_pose.empty();
    const bool is_here = is_staged || poses.gpu == kHostMemory || !poses.tool_of_pose.empty() ||
                         (to.is_within != nullptr && has_groups);
    if (given != nullptr && given->is_recording() && is_here) {
      return Error{Errc::invalid_argument,
                   "poses, indices or answers in host memory cannot be captured in a graph; give "
                   "arrays on GPU " +
                       std::to_string(gpu_)};
    }
    const std::size_t num = poses.X_WT.size();
    std::size_t at_once = at_once_;
    if (given != nullptr && !is_here) {
      at_once = std::max(at_once, kMoreThere * at_once_ / std::max<std::size_t>(seen_.size(), 1));
    }
    if (question.smoothing > 0) at_once = soft_at_once_;
    // Far more time than it takes.
    const double patience = 60 + static_cast<double>(num) / 1e4;
    if (to.is_within != nullptr && has_groups) {
      if (const Status status = clear_groups(poses, to, given); !status) return status;
    }
    for (Launch& launch : launches_) launch.num = 0;
    int turn = 0;
    for (std::size_t first = 0; first < num; first += at_once, turn = 1 - turn) {
      Launch& launch = given != nullptr ? launches_[2] : launches_[turn];
      launch.first = first;
      launch.num = std::min(at_once, num - first);
      enqueue(launch, poses, to, question, given != nullptr ? *given : launch.stream);
      if (is_staged) fetch(given != nullptr ? launch : launches_[1 - turn], poses, to, given);
    }
    if (is_staged) fetch(launches_[1 - turn], poses, to, given);
    if (given != nullptr) {
      if (is_here) return given->wait(patience);
      given->mark();
      return given->status();
    }
    for (Launch& launch : launches_) {
      if (const Status& status = launch.stream.wait(patience); !status) return status;
    }
    return Done{};
  }

  Status clear_groups(const ScenePoses& poses, const PoseAnswers& to, gpu::Stream* given) {
    const std::size_t num = num_groups_of(poses);
    if (to.gpu == kHostMemory) {
      std::fill_n(to.is_within, num, std::uint8_t{0});
      return Done{};
    }
    gpu::Stream& stream = given != nullptr ? *given : stream_;
    stream.clear(to.is_within, num);
    return given != nullptr ? stream.status() : stream.wait();
  }

  void enqueue(Launch& launch, const ScenePoses& poses, const PoseAnswers& to, Question question,
               gpu::Stream& stream) {
    const std::size_t first = launch.first, num = launch.num;
    const bool is_staged = to.gpu == kHostMemory;
    const auto on_gpu = [&]<class T>(T* there, const T* from) {
      stream.copy(there, from + first, num * sizeof(T));
      return there;
    };
    question.X_WT = poses.gpu != kHostMemory ? poses.X_WT.data() + first
                                             : on_gpu(launch.X_WT, poses.X_WT.data());
    if (!poses.tool_of_pose.empty()) {
      question.tool_of_pose = on_gpu(launch.tool_of_pose, poses.tool_of_pose.data());
    }
    for_answers(to, launch.staged, question,
                [&](auto* desired, auto* staged, std::size_t each, auto*& at) {
                  at = desired == nullptr ? nullptr : is_staged ? staged : desired + each * first;
                });
    if (to.is_within != nullptr && !is_staged && !poses.group_of_pose.empty()) {
      question.group_of_pose = on_gpu(launch.group_of_pose, poses.group_of_pose.data());
      question.is_within = to.is_within;
    }
    question.placed = launch.placed;
    question.is_near = launch.is_near;
    question.hits = launch.hits;
    question.found = launch.found;
    question.each = launch.each;
    question.num_poses = static_cast<std::int32_t>(num);
    const gpu::LaunchShape threads{.blocks = blocks_for(num, kThreads)};
    if (question.num_cameras > 0) {
      gpu::launch(stream, threads, place_poses, question);
      gpu::launch(stream, warps_for(num, kWarpsThatSearch), search_poses, question);
    }
    gpu::launch(stream, threads, refine_poses, question);
    if (question.num_bodies > 0) {
      gpu::launch(stream, warps_for(num, kWarpsAtBodies), search_bodies, question);
    }
    if (question.smoothing > 0) {
      gpu::launch(stream, warps_for(num, kWarpsThatSoften), soften_poses, question);
    }
    if (!question.is_refined_last()) gpu::launch(stream, threads, put_poses, question);
  }

  /// Copies the answers of a launch to the arrays of the caller in host memory.
  void fetch(Launch& launch, const ScenePoses& poses, const PoseAnswers& to, gpu::Stream* given) {
    const std::size_t first = launch.first, num = std::exchange(launch.num, 0);
    if (num == 0) return;
    gpu::Stream& stream = given != nullptr ? *given : launch.stream;
    PoseAnswers of_poses = to;
    const bool has_groups = to.is_within != nullptr && !poses.group_of_pose.empty();
    if (has_groups) of_poses.is_within = nullptr;
    Question none;
    for_answers(of_poses, launch.staged, none, [&](auto* at, auto* from, std::size_t each, auto*&) {
      if (at != nullptr) stream.copy(at + each * first, from, each * num * sizeof *at);
    });
    if (!has_groups) return;
    is_within_here_.resize(num);
    stream.copy(is_within_here_.data(), launch.staged.is_within, num);
    if (!stream.wait(60)) return;
    for (std::size_t i = 0; i < num; ++i) {
      if (is_within_here_[i] != 0) to.is_within[group_of(poses, first + i)] = 1;
    }
  }

  // The distance field of a shape.
  struct FieldOnGpu {
    std::optional<gpu::Memory> memory;
    const float* values = nullptr;
  };

  int gpu_;
  std::size_t at_once_;  // poses
  gpu::Memory memory_;
  gpu::Stream stream_, caller_stream_;
  bool is_known_ = false;  // the scene of the last question
  std::vector<SurfaceView> known_surfaces_;
  std::vector<PlacedBody> known_bodies_;
  ShapesOfScene<FieldOnGpu> shapes_;
  std::optional<gpu::Memory> bodies_;
  std::size_t num_bodies_ = 0;  // there is room for
  SearchedBody* bodies_on_gpu_ = nullptr;
  std::vector<SearchedBody> bodies_there_;
  std::vector<std::unique_ptr<ImageOnGpu>> images_;  // two of each surface
  std::vector<SeenByCamera> seen_;
  SeenByCamera* cameras_ = nullptr;
  std::optional<gpu::Memory> places_;
  std::size_t num_placed_ = 0;                // cameras that there is room for
  std::vector<std::uint8_t> is_within_here_;  // of the poses of a launch
  // Two take turns: while the GPU measures one, the results of the other are put where they belong.
  // The third is for streams of callers, which may still be at work.
  Launch launches_[3];
  Question question_;
  std::optional<gpu::Memory> hits_of_spheres_;
  std::size_t soft_at_once_ = 0;   // poses
  std::optional<TreeOnGpu> tree_;  // the last one
};

}  // namespace

Result<std::unique_ptr<ClearanceBatch>> make_clearance_batch_cuda(
    std::span<const std::shared_ptr<const ToolIndex>> tools, int gpu, std::size_t at_once) {
  if (const Status status = gpu::check_gpu(gpu); !status) return status.error();
  auto made = std::make_unique<ClearanceBatchCuda>(tools, gpu, at_once);
  if (const Status status = made->status(); !status) return status.error();
  return std::unique_ptr<ClearanceBatch>(std::move(made));
}

}}  // namespace palpate::v0
