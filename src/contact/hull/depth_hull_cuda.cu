#include "src/contact/hull/depth_hull_cuda.h"

#include <algorithm>
#include <type_traits>

#include "src/contact/blend.h"
#include "src/contact/cuda/finish_measure.cuh"
#include "src/contact/field/field_contact.h"
#include "src/contact/hull/hull_cameras.cuh"
#include "src/contact/hull/hull_elements.cuh"

namespace palpate { inline namespace v0 {
namespace {

template <class Sample>
using FinishScratchFor =
    std::conditional_t<std::is_same_v<Sample, Curvature>, FinishStiffnessScratch, FinishScratch>;
template <class Scratch, class Sample>
constexpr std::size_t kSharedBytes = std::max(sizeof(Scratch), sizeof(FinishScratchFor<Sample>));

// Every thread calls this last. As many threads add up in both kernels: so results have the same
// bits.
template <class Sample>
__device__ void finish(const MeasureOutput& out, const FieldShare& share,
                       const StiffnessShare& stiffness) {
  MeasureTerms mine;
  add_share(share, mine);
  auto& scratch = gpu::shared_memory<FinishScratchFor<Sample>>();
  if constexpr (std::is_same_v<Sample, Curvature>) {
    finish_measure(out, mine, stiffness.numbers, scratch, kHullThreads);
  } else {
    finish_measure(out, mine, scratch, kHullThreads);
  }
}

template <int kMaxViews, class Sample>
__global__ void __launch_bounds__(kHullThreads, 2)
    measure_hull_elements(const __grid_constant__ HullQuery<kMaxViews> query,
                          const __grid_constant__ PosedTool<kMaxViews> tool,
                          const __grid_constant__ MeasureOutput out) {
  FieldShare share;
  StiffnessShare stiffness;
  NoNoise noise;
  add_hull_elements(query, tool, static_cast<int>(blockIdx.x), static_cast<int>(gridDim.x), true,
                    gpu::shared_memory<ViewScratch<kMaxViews, Sample>>(), share, stiffness, noise);
  finish<Sample>(out, share, stiffness);
}

// For tools with a block for each cluster.
template <int kMaxViews, class Sample>
__global__ void __launch_bounds__(kWholeThreads, 2)
    measure_hull_clusters(const __grid_constant__ HullQuery<kMaxViews> query,
                          const __grid_constant__ PosedTool<kMaxViews> tool,
                          const __grid_constant__ MeasureOutput out) {
  FieldShare share;
  StiffnessShare stiffness;
  add_hull_cluster(query, tool, static_cast<int>(blockIdx.x),
                   gpu::shared_memory<WholeScratch<kMaxViews, Sample>>(), share, stiffness);
  finish<Sample>(out, share, stiffness);
}

template <int kMaxViews>
__global__ void describe_hull(const __grid_constant__ HullQuery<kMaxViews> query,
                              const __grid_constant__ PosedTool<kMaxViews> tool, const Vec3f p_TC,
                              const Sphere* spheres, int num, SphereCutsOnGpu to) {
  for (int id = gpu::grid_thread(); id < num; id += gpu::grid_threads()) {
    const Sphere sphere = spheres[id];
    const Vec3f c = sphere.center - p_TC;
    const Ball ball{c.x, c.y, c.z, sphere.radius, sphere.radius};
    const auto said = [&](int view) {
      return query_view<Gradient>(query, tool, view, ball,
                                  query.eyes[eye_of(query, view)].has_in_front);
    };
    using Space = SpaceGradient<float>;
    Joined<Space> at = join_seen<Space>(query, ball.radius, said);
    if (query.has_memory && needs_wider(query, at, ball.radius)) {
      const auto remembered = [&](int view) {
        return query_memory<Gradient>(query, tool, view, ball);
      };
      join_memories<Space>(query, ball.radius, remembered, at);
    }
    if (needs_wider(query, at, ball.radius)) {
      at.close(join_fields<Space>(query, ball.radius, said), ball.radius, true);
    }
    const Space& g = at.hull;
    to.states[id] = SphereState::outside;
    to.planes[id] = {};
    to.deciders[id] = kNoCamera;
    to.unseen[id] = at.is_unseen();
    if (!(g.phi < sphere.radius)) continue;
    if (at.decider >= 0) to.deciders[id] = static_cast<std::int8_t>(query.eyes[at.decider].number);
    to.states[id] = g.phi > -sphere.radius ? SphereState::boundary : SphereState::inside;
    const float(&R)[3][3] = tool.in_world.R_WT;
    const Vec3f along{R[0][0] * g.x + R[1][0] * g.y + R[2][0] * g.z,
                      R[0][1] * g.x + R[1][1] * g.y + R[2][1] * g.z,
                      R[0][2] * g.x + R[1][2] * g.y + R[2][2] * g.z};
    const float length = norm(along);
    const Vec3f n = along * (1.0f / (length > 1e-20f ? length : 1e-20f));
    to.planes[id] = {n, dot(n, sphere.center) - g.phi};
  }
}

int blocks_over(int num_threads, int threads) { return (num_threads + threads - 1) / threads; }

template <int kMaxViews, class Sample>
int resident_blocks(int gpu) {
  const auto resident = [gpu](auto* kernel, int threads, std::size_t bytes) {
    return gpu::resident_blocks(gpu, reinterpret_cast<const void*>(kernel), threads, bytes);
  };
  return std::min(resident(measure_hull_elements<kMaxViews, Sample>, kHullThreads,
                           kSharedBytes<ViewScratch<kMaxViews, Sample>, Sample>),
                  resident(measure_hull_clusters<kMaxViews, Sample>, kWholeThreads,
                           kSharedBytes<WholeScratch<kMaxViews, Sample>, Sample>));
}
template <class Sample>
int num_blocks(int gpu, int num_clusters, int most) {
  const int resident = std::min(resident_blocks<kFewCameras, Sample>(gpu),
                                resident_blocks<kMaxCameras, Sample>(gpu));
  return std::max(1, std::min(num_clusters, most > 0 ? most : resident));
}

}  // namespace

DepthHullCuda::DepthHullCuda(const FieldTool& tool, const Vec3d& p_TC, int num_spheres, int gpu,
                             int max_blocks)
    : tool_(tool),
      p_TC_(p_TC),
      num_spheres_(num_spheres),
      cameras_(std::make_unique<HullCameras>(gpu)),
      answers_(gpu, num_blocks<Gradient>(gpu, tool.elements.num_clusters, max_blocks)),
      stiffness_answers_(gpu, num_blocks<Curvature>(gpu, tool.elements.num_clusters, max_blocks),
                         AnswerBox::kMaxNumbers) {}

DepthHullCuda::~DepthHullCuda() = default;

const Status& DepthHullCuda::status() const {
  return answers_.status() ? stiffness_answers_.status() : answers_.status();
}

template <int kMaxViews, class Sample>
bool DepthHullCuda::launch(const HullCameras& cameras, AnswerBox& answers,
                           gpu::Stream& stream) noexcept {
  const auto launch = [&](auto* kernel, int threads, std::size_t bytes) {
    gpu::launch(stream, {.blocks = answers.num_blocks(), .threads = threads, .shared_bytes = bytes},
                kernel, cameras.query<kMaxViews>(), cameras.posed<kMaxViews>(tool_.elements),
                answers.next());
  };
  if (tool_.elements.num_clusters > answers.num_blocks()) {
    launch(measure_hull_elements<kMaxViews, Sample>, kHullThreads,
           kSharedBytes<ViewScratch<kMaxViews, Sample>, Sample>);
  } else {
    launch(measure_hull_clusters<kMaxViews, Sample>, kWholeThreads,
           kSharedBytes<WholeScratch<kMaxViews, Sample>, Sample>);
  }
  return answers.await(stream);
}

template <int kMaxViews>
void DepthHullCuda::describe(const HullCameras& cameras, const ContactWants& wants,
                             const SphereCutsOnGpu& cuts, gpu::Stream& stream) noexcept {
  constexpr int kThreads = 128, kMaxBlocks = 1024;
  const int blocks = std::min(blocks_over(num_spheres_, kThreads), kMaxBlocks);
  gpu::launch(stream, {.blocks = std::max(1, blocks), .threads = kThreads},
              describe_hull<kMaxViews>, cameras.query<kMaxViews>(),
              cameras.posed<kMaxViews>(tool_.elements), to_float(p_TC_), tool_.spheres,
              num_spheres_, cuts);
  if (!wants.states.empty()) {
    stream.copy(wants.states.data(), cuts.states, wants.states.size_bytes());
  }
  if (!wants.planes.empty()) {
    stream.copy(wants.planes.data(), cuts.planes, wants.planes.size_bytes());
  }
  if (!wants.deciders.empty()) {
    stream.copy(wants.deciders.data(), cuts.deciders, wants.deciders.size_bytes());
  }
  if (!wants.unseen.empty()) {
    stream.copy(wants.unseen.data(), cuts.unseen, wants.unseen.size_bytes());
  }
  stream.wait();
}

ContactResult DepthHullCuda::measure(std::span<const SurfaceBlend> cameras, const Pose& X_WT,
                                     const ContactWants& wants, const SphereCutsOnGpu& cuts,
                                     gpu::Stream& stream) noexcept {
  const ContactStatus status = cameras_->take(cameras, X_WT, p_TC_, tool_.reach, stream);
  if (status.is_unmeasured()) {
    ContactResult result = unmeasured(StepStatus::ok, wants, true);
    result.penetration.status = status;
    return result;
  }
  const bool is_few = cameras_->num() <= kFewCameras;
  AnswerBox& answers = wants.stiffness ? stiffness_answers_ : answers_;
  bool is_answered = false;
  if (wants.stiffness) {
    is_answered = is_few ? launch<kFewCameras, Curvature>(*cameras_, answers, stream)
                         : launch<kMaxCameras, Curvature>(*cameras_, answers, stream);
  } else {
    is_answered = is_few ? launch<kFewCameras, Gradient>(*cameras_, answers, stream)
                         : launch<kMaxCameras, Gradient>(*cameras_, answers, stream);
  }
  if (!is_answered) return unmeasured(StepStatus::backend_failed, wants, true);
  ContactResult result{answers.answer().penetration(), {}, {}};
  if (wants.stiffness) {
    const StiffnessSums sums = answers.stiffness();
    result.stiffness = sums.stiffness();
    result.moments = sums.moments();
  }
  keep_bounds(result);
  if (!wants.has_spheres()) return result;
  if (is_few) {
    describe<kFewCameras>(*cameras_, wants, cuts, stream);
  } else {
    describe<kMaxCameras>(*cameras_, wants, cuts, stream);
  }
  return result;
}

}}  // namespace palpate::v0
