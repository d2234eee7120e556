#include "src/contact/hull/depth_hull_cuda.h"

#include <algorithm>
#include <type_traits>

#include "src/contact/blend.h"
#include "src/contact/cuda/finish_measure.cuh"
#include "src/contact/field/field_contact.h"
#include "src/contact/field/whole_clusters_cuda.cuh"
#include "src/contact/hull/camera_seats.h"
#include "src/contact/hull/hull_joins.cuh"
#include "src/contact/hull/hull_views.cuh"
#include "src/contact/internal/hull_rules.h"

namespace palpate { inline namespace v0 {
namespace {

// A block has one cluster at a time; each of its warps samples some views for all its elements, and
// the first one joins the samples.
constexpr int kHullWarps = 8, kHullThreads = kHullWarps * gpu::kWarpSize;

// Samples of the views for the elements of a cluster.
template <int kMaxViews, class Sample>
struct ViewScratch {
  static constexpr int kNum = sizeof(InSpace<Sample>) / sizeof(float);

  float numbers[2 * kMaxViews][kNum][gpu::kWarpSize];
  float wholes[gpu::kWarpSize];
  int is_free, queries_memory;

  __device__ void store(int view, const InSpace<Sample>& said) {
    const float* const from = reinterpret_cast<const float*>(&said);
    for (int i = 0; i < kNum; ++i) numbers[view][i][gpu::lane_id()] = from[i];
  }
  __device__ InSpace<Sample> load(int view) const {
    InSpace<Sample> said;
    float* const to = reinterpret_cast<float*>(&said);
    for (int i = 0; i < kNum; ++i) to[i] = numbers[view][i][gpu::lane_id()];
    return said;
  }
};

template <class Sample>
using FinishScratchFor =
    std::conditional_t<std::is_same_v<Sample, Curvature>, FinishStiffnessScratch, FinishScratch>;
template <int kMaxViews, class Sample>
constexpr std::size_t kSharedBytes = std::max(sizeof(ViewScratch<kMaxViews, Sample>),
                                              sizeof(FinishScratchFor<Sample>));

/// Samples the hull for the ball of each lane, the same in all warps; the first warp returns its
/// values. The whole block calls. `in_front`: see queries_in_front, of a view.
template <class Sample, int kMaxViews, class InFront>
__device__ Joined<InSpace<Sample>> query_hull(const HullQuery<kMaxViews>& query, const Ball& ball,
                                              const InFront& in_front,
                                              ViewScratch<kMaxViews, Sample>& views) {
  using Space = InSpace<Sample>;
  for (int view = gpu::warp_id(); view < num_views(query); view += kHullWarps) {
    views.store(view, query_view<Sample>(query, view, ball, in_front(view)));
  }
  __syncthreads();
  const auto said = [&](int view) { return views.load(view); };
  Joined<Space> at_ball{};
  Space fields{};
  if (gpu::warp_id() == 0) {
    at_ball = join_seen<Space>(query, ball.radius, said);
    if (needs_wider(query, at_ball, ball.extent)) {
      fields = join_fields<Space>(query, ball.radius, said);
    }
  }
  if (query.has_memory) {
    // Samples of memories replace those of the views, if any element needs them.
    const bool needs_memory = gpu::warp_id() == 0 && needs_wider(query, at_ball, ball.extent);
    const bool any = __any_sync(gpu::kWholeWarp, needs_memory);
    if (threadIdx.x == 0) views.queries_memory = any;
    __syncthreads();
    if (views.queries_memory != 0) {
      for (int view = gpu::warp_id(); view < num_views(query); view += kHullWarps) {
        views.store(view, query_memory<Sample>(query, view, ball));
      }
      __syncthreads();
      if (needs_memory) join_memories<Space>(query, ball.radius, said, at_ball);
    }
  }
  if (gpu::warp_id() == 0 && needs_wider(query, at_ball, ball.extent)) {
    at_ball.take(fields, ball.radius, -1);
  }
  __syncthreads();
  return at_ball;
}

template <int kMaxViews, class Sample>
__global__ void __launch_bounds__(kHullThreads, 2)
    measure_hull_elements(const __grid_constant__ HullQuery<kMaxViews> query,
                          const __grid_constant__ MeasureOutput out) {
  constexpr bool kWithStiffness = std::is_same_v<Sample, Curvature>;
  const ElementsView& elements = query.elements;
  auto& views = gpu::shared_memory<ViewScratch<kMaxViews, Sample>>();
  FieldShare share;
  StiffnessShare stiffness;
  const auto add_unseen = [&](const Joined<InSpace<Sample>>& at, float factor, float radius) {
    if (!is_unseen(at)) return;
    share.unseen += factor * (static_cast<float>(4 * kPi / 3) * radius * radius * radius);
  };
  const int step = static_cast<int>(gridDim.x);
  // Each lane looks after a cluster as one ball (whole_clusters_cuda.cuh).
  for (int begin = static_cast<int>(blockIdx.x); begin < elements.num_clusters;
       begin += gpu::kWarpSize * step) {
    const int mine = begin + gpu::lane_id() * step;
    const int num_wholes = elements.first_ball >= kMinWholes ? elements.first_ball : 0;
    Joined<InSpace<Sample>> at_ball{};
    Curved<float> whole{};
    KeptSums kept;
    if (begin < num_wholes) {
      const ElementBall of = elements.wholes[mine < num_wholes ? mine : begin];
      at_ball = query_hull<Sample>(
          query, Ball{of.x, of.y, of.z, of.radius, of.radius},
          [&](int view) { return eye_of(query, view).has_in_front; }, views);
      if (mine < num_wholes && gpu::warp_id() == 0) {
        whole = whole_share(first_of(at_ball.hull).phi, elements.whole_depths[mine]);
      }
    }
    if (gpu::warp_id() == 0) views.wholes[gpu::lane_id()] = whole.value;
    __syncthreads();
    for (int lane = 0; lane < gpu::kWarpSize; ++lane) {
      const int cluster = begin + lane * step;
      if (cluster >= elements.num_clusters) break;
      const float left = 1.0f - views.wholes[lane];
      if (!(left > 0.0f)) continue;
      if (query.skips_clusters) {
        const bool is_free = gpu::warp_id() == 0 && is_seen_free(query, cluster);
        if (threadIdx.x == 0) views.is_free = is_free;
        __syncthreads();
        const bool is_skipped = views.is_free != 0;
        __syncthreads();
        if (is_skipped) continue;
      }
      const ElementBall at = elements.balls[cluster * SphereClusters::kSize + gpu::lane_id()];
      const bool is_ball = cluster >= elements.first_ball;
      const bool is_part = is_ball && gpu::lane_id() < kNumBallParts;
      const Ball ball{at.x, at.y, at.z, at.radius, (is_part ? kPartExtent : 1.0f) * at.radius};
      const Joined<InSpace<Sample>> at_ball = query_hull<Sample>(
          query, ball, [&](int view) { return queries_in_front(query, view, cluster); }, views);
      if (gpu::warp_id() != 0) continue;
      Element element = element_of(elements, cluster, query.tool);
      element.factor *= left;
      add_unseen(at_ball, element.factor, ball.radius);
      const SpaceGradient<float>& g = first_of(at_ball.hull);
      const bool is_touching = g.phi < ball.radius;
      const Symmetric<float> h = second_of(at_ball.hull);
      FieldShare of_cluster;
      if (is_ball) {
        add_ball<kWithStiffness>(elements.places, elements.ball_factor[cluster], element, g.phi,
                                 is_touching, is_complete(query, ball), {g.x, g.y, g.z}, h,
                                 of_cluster, &stiffness);
      } else if (is_touching) {
        add_cut<kWithStiffness>(element, g.phi, {g.x, g.y, g.z}, h, of_cluster, &stiffness);
      }
      share.add(of_cluster);
      if (left < 1.0f) {
        KeptSums all;
        all.keep(of_cluster, left);
        if (gpu::lane_id() == lane) kept = all;
      }
    }
    if (whole.value > 0.0f) {
      const Element element =
          element_of(elements.wholes[mine], elements.whole_factors[mine], query.tool);
      add_whole<kWithStiffness>(element, elements.whole_polars[mine], whole, kept,
                                first_of(at_ball.hull), second_of(at_ball.hull), share, &stiffness);
      add_unseen(at_ball, whole.value * element.factor, element.radius);
      if (!(whole.value < 1.0f)) share.num_inside += static_cast<int>(elements.whole_counts[mine]);
    }
    __syncthreads();
  }
  MeasureTerms mine;
  add_share(share, mine);
  auto& scratch = gpu::shared_memory<FinishScratchFor<Sample>>();
  if constexpr (kWithStiffness) {
    finish_measure(out, mine, stiffness.numbers, scratch);
  } else {
    finish_measure(out, mine, scratch);
  }
}

template <int kMaxViews>
__global__ void describe_hull(const __grid_constant__ HullQuery<kMaxViews> query, const Vec3f p_TC,
                              const Sphere* spheres, int num, SphereCutsOnGpu to) {
  for (int id = gpu::grid_thread(); id < num; id += gpu::grid_threads()) {
    const Sphere sphere = spheres[id];
    const Vec3f c = sphere.center - p_TC;
    const Ball ball{c.x, c.y, c.z, sphere.radius, sphere.radius};
    const auto said = [&](int view) {
      return query_view<Gradient>(query, view, ball, eye_of(query, view).has_in_front);
    };
    using Space = SpaceGradient<float>;
    Joined<Space> at = join_seen<Space>(query, ball.radius, said);
    if (query.has_memory && needs_wider(query, at, ball.radius)) {
      const auto remembered = [&](int view) { return query_memory<Gradient>(query, view, ball); };
      join_memories<Space>(query, ball.radius, remembered, at);
    }
    if (needs_wider(query, at, ball.radius)) {
      at.take(join_fields<Space>(query, ball.radius, said), ball.radius, -1);
    }
    const Space& g = at.hull;
    to.states[id] = SphereState::outside;
    to.planes[id] = {};
    to.deciders[id] = kNoCamera;
    to.unseen[id] = is_unseen(at);
    if (!(g.phi < sphere.radius)) continue;
    if (at.decider >= 0) to.deciders[id] = static_cast<std::int8_t>(query.eyes[at.decider].number);
    to.states[id] = g.phi > -sphere.radius ? SphereState::boundary : SphereState::inside;
    const float(&R)[3][3] = query.tool.R_WT;
    const Vec3f along{R[0][0] * g.x + R[1][0] * g.y + R[2][0] * g.z,
                      R[0][1] * g.x + R[1][1] * g.y + R[2][1] * g.z,
                      R[0][2] * g.x + R[1][2] * g.y + R[2][2] * g.z};
    const float length = norm(along);
    const Vec3f n = along * (1.0f / (length > 1e-20f ? length : 1e-20f));
    to.planes[id] = {n, dot(n, sphere.center) - g.phi};
  }
}

int blocks_over(int num_threads, int threads) { return (num_threads + threads - 1) / threads; }

template <class Sample>
int num_blocks(int gpu, int num_clusters) {
  const int resident =
      std::min(gpu::resident_blocks(
                   gpu, reinterpret_cast<const void*>(&measure_hull_elements<kFewCameras, Sample>),
                   kHullThreads, kSharedBytes<kFewCameras, Sample>),
               gpu::resident_blocks(
                   gpu, reinterpret_cast<const void*>(&measure_hull_elements<kMaxCameras, Sample>),
                   kHullThreads, kSharedBytes<kMaxCameras, Sample>));
  return std::max(1, std::min(num_clusters, resident));
}

}  // namespace

// Arguments of a query but the tool.
struct DepthHullCuda::Views {
  HullEye eyes[kMaxCameras];
  int num = 0, num_seeing = 0;
  bool is_alone = false, has_memory = false;
  FieldFrame tool;
};

DepthHullCuda::DepthHullCuda(const FieldTool& tool, const Vec3d& p_TC, int num_spheres, int gpu)
    : tool_(tool),
      p_TC_(p_TC),
      num_spheres_(num_spheres),
      answers_(gpu, num_blocks<Gradient>(gpu, tool.elements.num_clusters)),
      stiffness_answers_(gpu, num_blocks<Curvature>(gpu, tool.elements.num_clusters),
                         AnswerBox::kMaxNumbers) {
  for (int i = 0; i < 4 * kMaxCameras; ++i) copies_.emplace_back(gpu);
}

const Status& DepthHullCuda::status() const {
  return answers_.status() ? stiffness_answers_.status() : answers_.status();
}

ContactStatus DepthHullCuda::take(std::span<const SurfaceBlend> cameras, const Pose& X_WT,
                                  gpu::Stream& stream, Views& views) noexcept {
  views.tool = frame_of({}, X_WT, p_TC_);
  views.is_alone = is_alone(cameras);
  for (const bool sees : {true, false}) {
    for (std::size_t k = 0; k < cameras.size(); ++k) {
      const SurfaceView& surface = cameras[k].to;
      if (surface.field.num_levels == 0) continue;  // no frame yet: it abstains
      if (is_seen(surface, views.is_alone) != sees) continue;
      const ContactStatus status = take(cameras[k], X_WT, static_cast<int>(k), stream, views);
      if (status.is_unmeasured()) return status;
    }
    if (sees) views.num_seeing = views.num;
  }
  return views.num_seeing > 0 ? StepStatus::ok : StepStatus::no_surface;
}

ContactStatus DepthHullCuda::take(const SurfaceBlend& view, const Pose& X_WT, int number,
                                  gpu::Stream& stream, Views& views) noexcept {
  const SurfaceView &from = view.from, &to = view.to;
  const double progress = view.progress;
  if (!has_fields(to, views.is_alone)) return StepStatus::no_surface;
  const CameraSeats seats(view, X_WT, views.is_alone);
  if (seats.is_outside_window(view, p_TC_, tool_.reach)) return StepStatus::outside_window;
  GpuFields* const copies = &copies_[4 * static_cast<std::size_t>(number)];
  const auto look = [&](GpuFields& copy, const DepthFieldView& of, int seat) {
    return look_of(copy.on_gpu(of, stream), frame_of(to.field.intrinsics, seats.X_CT[seat], p_TC_),
                   1);
  };
  HullEye& eye = views.eyes[views.num++];
  eye.number = number;
  eye.num_fields = seats.num_moments;
  eye.has_moved = seats.has_moved;
  eye.progress = static_cast<float>(progress);
  eye.has_in_front = views.is_alone && has_in_front(to);
  eye.is_remembered = !views.is_alone && is_remembered(to);
  views.has_memory |= eye.is_remembered;
  for (int f = eye.num_fields - 1; f >= 0; --f) {
    const SurfaceView& surface = f == 0 ? to : from;
    eye.field[f] = look(copies[0], surface.field, f);
    eye.seen_free[f] = surface.role == SurfaceRole::one_of_several
                           ? look(copies[1], surface.seen_free, f)
                           : eye.field[f];
    // A surface without thickness is solid as far as its camera sees.
    eye.in_front[f] = has_in_front(to) ? look(copies[2], surface.in_front, f) : eye.field[f];
    if (eye.is_remembered) eye.remembered[f] = look(copies[3], surface.remembered, f);
  }
  seats.write_rotations(eye.R_WC);
  return StepStatus::ok;
}

namespace {

template <int kMaxViews, class Views>
HullQuery<kMaxViews> query_of(const Views& views, const ElementsView& elements) {
  HullQuery<kMaxViews> query;
  query.elements = elements;
  query.tool = views.tool;
  query.num_cameras = views.num;
  query.num_seeing = views.num_seeing;
  query.is_alone = views.is_alone;
  query.has_memory = views.has_memory;
  std::copy_n(views.eyes, views.num, query.eyes);
  return query;
}

}  // namespace

template <int kMaxViews, class Sample>
bool DepthHullCuda::launch(const Views& views, AnswerBox& answers, gpu::Stream& stream) noexcept {
  HullQuery<kMaxViews> query = query_of<kMaxViews>(views, tool_.elements);
  query.skips_clusters = tool_.elements.num_clusters > answers.num_blocks();
  gpu::launch(stream,
              {.blocks = answers.num_blocks(),
               .threads = kHullThreads,
               .shared_bytes = kSharedBytes<kMaxViews, Sample>},
              measure_hull_elements<kMaxViews, Sample>, query, answers.next());
  return answers.await(stream);
}

template <int kMaxViews>
void DepthHullCuda::describe(const Views& views, const ContactWants& wants,
                             const SphereCutsOnGpu& cuts, gpu::Stream& stream) noexcept {
  constexpr int kThreads = 128, kMaxBlocks = 1024;
  const int blocks = std::min(blocks_over(num_spheres_, kThreads), kMaxBlocks);
  gpu::launch(stream, {.blocks = std::max(1, blocks), .threads = kThreads},
              describe_hull<kMaxViews>, query_of<kMaxViews>(views, tool_.elements), to_float(p_TC_),
              tool_.spheres, num_spheres_, cuts);
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
  Views views;
  const ContactStatus status = take(cameras, X_WT, stream, views);
  if (status.is_unmeasured()) {
    ContactResult result = unmeasured(StepStatus::ok, wants, true);
    result.penetration.status = status;
    return result;
  }
  const bool is_few = views.num <= kFewCameras;
  AnswerBox& answers = wants.stiffness ? stiffness_answers_ : answers_;
  bool is_answered = false;
  if (wants.stiffness) {
    is_answered = is_few ? launch<kFewCameras, Curvature>(views, answers, stream)
                         : launch<kMaxCameras, Curvature>(views, answers, stream);
  } else {
    is_answered = is_few ? launch<kFewCameras, Gradient>(views, answers, stream)
                         : launch<kMaxCameras, Gradient>(views, answers, stream);
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
    describe<kFewCameras>(views, wants, cuts, stream);
  } else {
    describe<kMaxCameras>(views, wants, cuts, stream);
  }
  return result;
}

}}  // namespace palpate::v0
