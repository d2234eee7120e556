#include <algorithm>
#include <optional>
#include <string>
#include <utility>

#include "src/contact/batch/scene_batch.h"
#include "src/contact/batch/scene_noise.cuh"
#include "src/contact/batch/staged_answers.h"
#include "src/contact/bodies/shapes_of_scene.h"
#include "src/contact/hull/hull_cameras.cuh"
#include "src/contact/noise/batch_rows.h"

namespace palpate { inline namespace v0 {
namespace {

// A shape with each tool.
struct PairsOnGpu {
  std::optional<gpu::Memory> memory;
  std::vector<ScenePair> pairs;
};

class SceneBatchCuda final : public SceneBatch {
 public:
  SceneBatchCuda(std::span<const std::shared_ptr<const ToolIndex>> tools, SphereVolumes volumes,
                 int gpu, std::size_t at_once)
      : gpu_(gpu),
        at_once_(at_once),
        tools_(tools.begin(), tools.end()),
        memory_(gpu),
        own_stream_(gpu, gpu::Priority::low),
        caller_stream_(gpu),
        cameras_(gpu),
        of_shapes_(gpu),
        of_scene_(gpu),
        staged_(gpu) {
    std::vector<SceneTool> made;
    for (const auto& index : tools_) {
      made.push_back({make_field_tool(*index, volumes, memory_).elements,
                      index->tool().sphere_mass().center_of_mass,
                      full_volume(index->tool(), volumes)});
      max_clusters_ = std::max(max_clusters_, made.back().elements.num_clusters);
    }
    on_gpu_ = memory_.copy_of(made);
    allow_shared_bytes<kFewCameras>();
    allow_shared_bytes<kMaxCameras>();
  }

  const Status& status() const {
    return memory_.status() ? own_stream_.status() : memory_.status();
  }

  Status take(std::span<const SurfaceView> surfaces, std::span<const PlacedBody> bodies,
              std::optional<CallerStream> desired) override {
    gpu::Stream& stream = stream_for(desired);
    const bool is_last = show_same(surfaces_, surfaces);
    const bool is_here = !is_last && !show_same(before_, surfaces) &&
                         std::ranges::any_of(surfaces, [&](const SurfaceView& surface) {
                           return surface.field.num_levels > 0 && surface.field.gpu != gpu_;
                         });
    const bool has_bodies = are_last(bodies);
    if (is_here || !has_bodies) {
      if (stream.is_recording()) return late_in_graph("a scene that was not asked before");
      if (const Status& waited = stream.wait(60); !waited) return waited;  // for the last scene
    }
    if (!is_last) before_.swap(surfaces_);
    surfaces_.assign(surfaces.begin(), surfaces.end());
    blends_.clear();
    for (const SurfaceView& surface : surfaces_) blends_.push_back({surface, surface, 1});
    (void)cameras_.take(blends_, {}, {}, 0, stream);
    const bool is_by_itself =
        surfaces_.size() == 1 && surfaces_[0].field.num_levels > 0 &&
        (surfaces_[0].role == SurfaceRole::frame || surfaces_[0].role == SurfaceRole::with_memory);
    one_camera_ = is_by_itself ? cameras_.one_camera(surfaces_[0], stream) : OneCamera{};
    if (!has_bodies) {
      if (const Status status = take_bodies(bodies); !status) return status;
    }
    return is_here ? stream.wait() : stream.status();
  }

  Status measure(const SceneBatchPoses& poses, const BatchAnswers& answers, double* unseen,
                 std::optional<CallerStream> desired) override {
    if (poses.X_WT.empty()) return Done{};
    gpu::Stream& stream = stream_for(desired);
    const bool is_here = poses.gpu != gpu_ || answers.gpu != gpu_ || !poses.tool_of_pose.empty() ||
                         !poses.body_of_pose.empty();
    if (is_here) {
      if (stream.is_recording()) return late_in_graph("poses, indices or answers in host memory");
      const std::size_t most = std::min(poses.X_WT.size(), at_once_);
      if (const Status status = staged_.grow(most); !status) return status;
    }
    if (answers.want_noise() && cameras_.num() > 0 && !noise_rows_.is_taken()) {
      if (stream.is_recording()) return late_in_graph("standard deviations of a contact");
      const int resident =
          std::min(resident_for_noise<kFewCameras>(), resident_for_noise<kMaxCameras>());
      if (const Status s = noise_rows_.take(gpu_, max_clusters_, 1, resident); !s) return s;
    }
    if (cameras_.num() <= kFewCameras) {
      launch_all<kFewCameras>(poses, answers, unseen, stream);
    } else {
      launch_all<kMaxCameras>(poses, answers, unseen, stream);
    }
    if (desired && !is_here) {
      stream.mark();
      return stream.status();
    }
    // Far more time than it takes.
    const double slowdown = answers.want_noise() ? noise_rows_.slowdown() : 1;
    return stream.wait(60 + slowdown * static_cast<double>(poses.X_WT.size()) / 1e3);
  }

 private:
  /// Returns the stream of a call; its work comes after that of the last one in another stream.
  gpu::Stream& stream_for(const std::optional<CallerStream>& desired) {
    caller_stream_.continue_in(desired ? desired->handle : own_stream_.handle());
    return desired ? caller_stream_ : own_stream_;
  }

  Error late_in_graph(const std::string& what) const {
    return {Errc::invalid_argument,
            what + " cannot be captured in a graph; ask it once before, with arrays on GPU " +
                std::to_string(gpu_)};
  }

  bool are_last(std::span<const PlacedBody> bodies) const {
    return is_known_ && std::ranges::equal(known_, bodies, [](const auto& a, const auto& b) {
             return a.shape == b.shape && a.X_WB == b.X_WB;
           });
  }
  Status take_bodies(std::span<const PlacedBody> bodies) {
    const bool had_pairs = std::exchange(is_known_, false);
    num_bodies_ = 0;
    const Status status = shapes_.take(
        bodies.size(), [&](std::size_t b) -> const auto& { return bodies[b].shape; },
        [this](const auto& shape) { return pairs_of(shape); });
    if (!status) return status;
    std::vector<SceneBody> placed;
    for (std::size_t b = 0; b < bodies.size(); ++b) {
      placed.push_back({static_cast<std::int32_t>(shapes_.shape_of_body(b)),
                        is_finite(bodies[b].X_WB), bodies[b].X_WB});
    }
    if (!had_pairs || shapes_.has_changed()) {
      std::vector<ScenePair> pairs;
      for (std::size_t shape = 0; shape < shapes_.size(); ++shape) {
        const auto& of_shape = shapes_.of_shape(shape).pairs;
        pairs.insert(pairs.end(), of_shape.begin(), of_shape.end());
      }
      of_shapes_ = gpu::Memory(gpu_);
      pairs_ = of_shapes_.copy_of(pairs);
      if (!of_shapes_.status()) return of_shapes_.status();
    }
    of_scene_ = gpu::Memory(gpu_);
    bodies_ = of_scene_.copy_of(placed);
    if (!of_scene_.status()) return of_scene_.status();
    num_bodies_ = static_cast<std::int32_t>(placed.size());
    known_.assign(bodies.begin(), bodies.end());
    is_known_ = true;
    return Done{};
  }

  template <int kMaxViews>
  void allow_shared_bytes() const {
    for_kernels<kMaxViews>([this](auto* kernel, std::size_t bytes) {
      (void)gpu::resident_blocks(gpu_, reinterpret_cast<const void*>(kernel), kHullThreads, bytes);
    });
  }
  template <int kMaxViews>
  int resident_for_noise() const {
    return gpu::resident_blocks(gpu_,
                                reinterpret_cast<const void*>(&measure_scene_deviations<kMaxViews>),
                                kHullThreads, sizeof(SceneNoiseScratch<kMaxViews>));
  }
  template <int kMaxViews, class F>
  static void for_kernels(const F& f) {
    f(&measure_scene<kMaxViews, Gradient>, sizeof(SceneScratch<kMaxViews, Gradient>));
    f(&measure_scene<kMaxViews, Curvature>, sizeof(SceneScratch<kMaxViews, Curvature>));
  }

  Result<PairsOnGpu> pairs_of(const std::shared_ptr<const ToolIndex>& shape) const {
    PairsOnGpu made;
    gpu::Memory& memory = made.memory.emplace(gpu_);
    for (const auto& tool : tools_) {
      const SolidPair pair(tool, shape);
      made.pairs.push_back({way_on_gpu(*pair.elements_a, pair.sampling_a, *pair.field_b, memory),
                            way_on_gpu(*pair.elements_b, pair.sampling_b, *pair.field_a, memory),
                            pair.weights, pair.field_a->layout().origin,
                            pair.field_b->layout().origin});
    }
    if (!memory.status()) return memory.status().error();
    return Result<PairsOnGpu>(std::move(made));  // nvcc copies what is named
  }

  template <int kMaxViews>
  void launch_all(const SceneBatchPoses& poses, const BatchAnswers& answers, double* unseen,
                  gpu::Stream& stream) {
    const std::size_t num = poses.X_WT.size();
    SceneNoiseJob<kMaxViews> with_noise;
    SceneJob<kMaxViews>& job = with_noise.scene;
    job.query = cameras_.query<kMaxViews>();
    for (int k = 0; k < job.query.num_cameras; ++k) {
      job.X_WC[k] = surfaces_[static_cast<std::size_t>(job.query.eyes[k].number)].X_WC;
      if (!answers.want_noise()) continue;
      with_noise.noises[k] = cameras_.noise(k);
      with_noise.is_known &= with_noise.noises[k].is_known != 0;
    }
    with_noise.kept = noise_rows_.rows();
    job.tools = on_gpu_;
    job.num_tools = static_cast<std::int32_t>(tools_.size());
    job.pairs = pairs_;
    job.bodies = bodies_;
    job.num_bodies = num_bodies_;
    job.has_one_body_each = poses.has_one_body_each;
    const bool with_stiffness = answers.stiffness != nullptr;
    for (std::size_t first = 0; first < num; first += at_once_) {
      const std::size_t size = std::min(at_once_, num - first);
      // Bodies by pose are staged from this pose on; without them, the pose's number is the body's.
      job.first_pose = poses.body_of_pose.empty() ? static_cast<std::int32_t>(first) : 0;
      job.X_WT = poses.gpu == gpu_ ? poses.X_WT.data() + first
                                   : staged_.given(stream, staged_.X_WT, poses.X_WT, first, size);
      job.tool_of_pose = staged_.given(stream, staged_.tool, poses.tool_of_pose, first, size);
      job.body_of_pose = staged_.given(stream, staged_.body, poses.body_of_pose, first, size);
      const bool is_staged = answers.gpu != gpu_;
      for_answers(answers, staged_.answers, job.out,
                  [&](auto* desired, auto* staged, std::size_t each, auto*& to) {
                    to = desired == nullptr ? nullptr : is_staged ? staged : desired + each * first;
                  });
      job.unseen = unseen == nullptr ? nullptr : is_staged ? staged_.unseen : unseen + first;
      if (unseen != nullptr && one_camera_.num > 0) {
        launch_unseen(job, static_cast<std::int32_t>(size), stream);
        job.unseen = nullptr;
      }
      const auto launch = [&](auto* kernel, std::size_t bytes) {
        gpu::launch(
            stream,
            {.blocks = static_cast<int>(size), .threads = kHullThreads, .shared_bytes = bytes},
            kernel, job);
      };
      const BatchAnswers& out = job.out;
      const bool has_any = out.volume || out.potential || out.force || out.torque ||
                           out.stiffness || out.status || job.unseen;
      if (!has_any) {
        // Unseen space alone is requested.
      } else if (with_stiffness) {
        launch(&measure_scene<kMaxViews, Curvature>, sizeof(SceneScratch<kMaxViews, Curvature>));
      } else {
        launch(&measure_scene<kMaxViews, Gradient>, sizeof(SceneScratch<kMaxViews, Gradient>));
      }
      if (out.want_noise()) launch_noise(with_noise, size, stream);
      if (!is_staged) continue;
      copy_answers(answers, staged_.answers, first, size, stream);
      if (unseen != nullptr) stream.copy(unseen + first, staged_.unseen, size * sizeof(double));
    }
  }

  template <int kMaxViews>
  void launch_noise(SceneNoiseJob<kMaxViews>& job, std::size_t num, gpu::Stream& stream) const {
    const BatchAnswers& out = job.scene.out;
    if (cameras_.num() == 0) {  // bodies have none
      if (out.volume_std != nullptr) stream.clear(out.volume_std, num * sizeof(double));
      for (double* const of : {out.force_std, out.torque_std}) {
        if (of != nullptr) stream.clear(of, 3 * num * sizeof(double));
      }
      return;
    }
    job.num_poses = static_cast<std::int32_t>(num);
    gpu::launch(stream,
                {.blocks = std::min(job.num_poses, noise_rows_.num_blocks()),
                 .threads = kHullThreads,
                 .shared_bytes = sizeof(SceneNoiseScratch<kMaxViews>)},
                measure_scene_deviations<kMaxViews>, job);
  }

  template <class Job>
  void launch_unseen(const Job& of, std::int32_t num, gpu::Stream& stream) const {
    UnseenJob job;
    job.camera = one_camera_;
    job.frame = frame_of(one_camera_.fields[0].intrinsics, {}, {});
    job.X_WC = surfaces_[0].X_WC;
    job.tools = on_gpu_;
    job.X_WT = of.X_WT;
    job.tool_of_pose = of.tool_of_pose;
    job.num = num;
    job.unseen = of.unseen;
    gpu::launch(stream,
                {.blocks = (num + kUnseenWarps - 1) / kUnseenWarps,
                 .threads = kUnseenWarps * gpu::kWarpSize},
                measure_unseen, job);
  }

  int gpu_;
  std::size_t at_once_;  // poses in a launch
  std::vector<std::shared_ptr<const ToolIndex>> tools_;
  int max_clusters_ = 0;
  gpu::Memory memory_;
  gpu::Stream own_stream_, caller_stream_;
  const SceneTool* on_gpu_ = nullptr;
  std::vector<SurfaceView> surfaces_, before_;  // the last ones, and those before, copied, too
  std::vector<SurfaceBlend> blends_;
  HullCameras cameras_;
  OneCamera one_camera_;
  ShapesOfScene<PairsOnGpu> shapes_;
  gpu::Memory of_shapes_, of_scene_;
  bool is_known_ = false;  // what lies there is of these bodies
  std::vector<PlacedBody> known_;
  const ScenePair* pairs_ = nullptr;
  const SceneBody* bodies_ = nullptr;
  std::int32_t num_bodies_ = 0;
  StagedPoses staged_;
  BatchRows noise_rows_;
};

Error refused(const std::string& message) { return {Errc::invalid_argument, message}; }

class BodyBatchCuda final : public BodyBatchQuery {
 public:
  BodyBatchCuda(std::unique_ptr<SceneBatch> scenes, std::size_t num_bodies, int gpu)
      : scenes_(std::move(scenes)), num_bodies_(num_bodies), gpu_(gpu) {}

  Status measure(std::span<const Pose> X_WT, std::span<const std::int32_t> body_of_pose,
                 const BatchAnswers& answers) const override {
    if (const Status s = check_body_batch(X_WT.size(), body_of_pose.size(), num_bodies_); !s) {
      return s;
    }
    if (answers.gpu != kHostMemory && answers.gpu != gpu_) {
      return refused("an array for answers in the memory of GPU " + std::to_string(answers.gpu) +
                     " was given to a batch on GPU " + std::to_string(gpu_) +
                     "; take one there, or in host memory");
    }
    return scenes_->measure({.X_WT = X_WT, .has_one_body_each = true, .body_of_pose = body_of_pose},
                            answers, nullptr, {});
  }

 private:
  std::unique_ptr<SceneBatch> scenes_;
  std::size_t num_bodies_;
  int gpu_;
};

}  // namespace

Result<std::unique_ptr<SceneBatch>> make_scene_batch_cuda(
    std::span<const std::shared_ptr<const ToolIndex>> tools, SphereVolumes volumes, int gpu,
    std::size_t at_once) {
  if (const Status status = gpu::check_gpu(gpu); !status) return status.error();
  auto batch = std::make_unique<SceneBatchCuda>(tools, volumes, gpu, at_once);
  if (const Status status = batch->status(); !status) return status.error();
  return std::unique_ptr<SceneBatch>(std::move(batch));
}

Result<std::unique_ptr<BodyBatchQuery>> make_body_batch_query_cuda(
    const std::shared_ptr<const ToolIndex>& tool, const std::vector<PlacedBody>& bodies, int gpu) {
  auto made = make_scene_batch_cuda({&tool, 1}, SphereVolumes::represented, gpu);
  if (!made) return made.error();
  if (const Status status = (*made)->take({}, bodies, {}); !status) return status.error();
  return std::unique_ptr<BodyBatchQuery>(
      std::make_unique<BodyBatchCuda>(*std::move(made), bodies.size(), gpu));
}

}}  // namespace palpate::v0
