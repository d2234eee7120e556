// The elements of a tool against the hull on a GPU, and their sums. A block takes one cluster at a
// time: each of its warps samples some views for all its elements, and the first one joins the
// samples.
#pragma once

#include "src/contact/field/whole_clusters_cuda.cuh"
#include "src/contact/hull/hull_joins.cuh"

namespace palpate { inline namespace v0 { namespace {

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

/// Samples the hull for the ball of each lane, the same in all warps; the first warp returns its
/// values. The whole block calls. `in_front`: see queries_in_front, of a view.
template <class Sample, int kMaxViews, class InFront>
__device__ Joined<InSpace<Sample>> query_hull(const HullQuery<kMaxViews>& query,
                                              const PosedTool<kMaxViews>& tool, const Ball& ball,
                                              const InFront& in_front,
                                              ViewScratch<kMaxViews, Sample>& views) {
  using Space = InSpace<Sample>;
  for (int view = gpu::warp_id(); view < num_views(query); view += kHullWarps) {
    views.store(view, query_view<Sample>(query, tool, view, ball, in_front(view)));
  }
  __syncthreads();
  const auto said = [&](int view) { return views.load(view); };
  Joined<Space> at_ball{};
  typename Joined<Space>::Least fields;
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
        views.store(view, query_memory<Sample>(query, tool, view, ball));
      }
      __syncthreads();
      if (needs_memory) join_memories<Space>(query, ball.radius, said, at_ball);
    }
  }
  if (gpu::warp_id() == 0 && needs_wider(query, at_ball, ball.extent)) {
    at_ball.close(fields, ball.radius, true);
  }
  __syncthreads();
  return at_ball;
}

/// Lets `noise` look at the ball of each lane from the camera that decides it.
template <int kMaxViews, class Noise>
__device__ void look_from_decider(const HullQuery<kMaxViews>& query,
                                  const PosedTool<kMaxViews>& tool, int decider, const Ball& ball,
                                  Noise& noise) {
  if constexpr (Noise::kWants) {
    if (decider < 0) {
      noise.look_away();
      return;
    }
    const FieldFrame& frame = tool.in_eyes[decider][0];
    float p[3];
    place(frame, ball, p);
    p[2] = p[2] > kMinDepth ? p[2] : kMinDepth;
    noise.look(frame, look_at(frame, p), ball.radius, query.eyes[decider].R_WC[0], decider);
  }
}

/// Adds every `step`-th cluster from `first` on, and leaves out those that a camera sees to be free
/// if it `skips_clusters`: that pays if the block has several. `noise`: a NoiseKeeper, of which
/// that of the first warp is used, or NoNoise. The whole block calls.
template <int kMaxViews, class Sample, class Noise>
__device__ void add_hull_elements(const HullQuery<kMaxViews>& query,
                                  const PosedTool<kMaxViews>& tool, int first, int step,
                                  bool skips_clusters, ViewScratch<kMaxViews, Sample>& views,
                                  FieldShare& share, StiffnessShare& stiffness, Noise& noise) {
  constexpr bool kWithStiffness = std::is_same_v<Sample, Curvature>;
  const ElementsView& elements = tool.elements;
  const auto add_unseen = [&](const Joined<InSpace<Sample>>& at, float factor, float radius) {
    if (!at.is_unseen()) return;
    share.unseen += factor * (static_cast<float>(4 * kPi / 3) * radius * radius * radius);
  };
  // Each lane looks after a cluster as one ball (whole_clusters_cuda.cuh).
  for (int begin = first; begin < elements.num_clusters; begin += gpu::kWarpSize * step) {
    const int mine = begin + gpu::lane_id() * step;
    const int num_wholes = elements.first_ball >= kMinWholes ? elements.first_ball : 0;
    Joined<InSpace<Sample>> at_whole{};
    Curved<float> whole{};
    Ball of_whole{};
    KeptSums kept;
    if (begin < num_wholes) {
      const ElementBall of = elements.wholes[mine < num_wholes ? mine : begin];
      of_whole = {of.x, of.y, of.z, of.radius, of.radius};
      at_whole = query_hull<Sample>(
          query, tool, of_whole,
          [&](int view) { return query.eyes[eye_of(query, view)].has_in_front; }, views);
      if (mine < num_wholes && gpu::warp_id() == 0) {
        whole = whole_share(first_of(at_whole.hull).phi, elements.whole_depths[mine]);
      }
    }
    if (gpu::warp_id() == 0) views.wholes[gpu::lane_id()] = whole.value;
    __syncthreads();
    for (int lane = 0; lane < gpu::kWarpSize; ++lane) {
      const int cluster = begin + lane * step;
      if (cluster >= elements.num_clusters) break;
      const float left = 1.0f - views.wholes[lane];
      if (!(left > 0.0f)) continue;
      if (skips_clusters) {
        const bool is_free = gpu::warp_id() == 0 && is_seen_free(query, tool, cluster);
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
          query, tool, ball, [&](int view) { return queries_in_front(query, tool, view, cluster); },
          views);
      if (gpu::warp_id() != 0) continue;
      Element element = element_of(elements, cluster, tool.in_world);
      element.factor *= left;
      add_unseen(at_ball, element.factor, ball.radius);
      const SpaceGradient<float>& g = first_of(at_ball.hull);
      const bool is_touching = g.phi < ball.radius;
      const Symmetric<float> h = second_of(at_ball.hull);
      FieldShare of_cluster;
      look_from_decider(query, tool, at_ball.decider, ball, noise);
      if (is_ball) {
        Noise own = noise;
        add_ball<kWithStiffness>(elements.places, elements.ball_factor[cluster], element, g.phi,
                                 is_touching, is_complete(query, tool, ball), {g.x, g.y, g.z}, h,
                                 of_cluster, &stiffness, own);
        noise = own;
      } else if (is_touching) {
        add_cut<kWithStiffness>(element, g.phi, {g.x, g.y, g.z}, h, of_cluster, &stiffness, noise);
      }
      noise.keep();
      share.add(of_cluster);
      if (left < 1.0f) {
        KeptSums all;
        all.keep(of_cluster, left);
        if (gpu::lane_id() == lane) kept = all;
      }
    }
    if (whole.value > 0.0f) {
      const Element element =
          element_of(elements.wholes[mine], elements.whole_factors[mine], tool.in_world);
      look_from_decider(query, tool, at_whole.decider, of_whole, noise);
      add_whole<kWithStiffness>(element, elements.whole_polars[mine], whole, kept,
                                first_of(at_whole.hull), second_of(at_whole.hull), share,
                                &stiffness, noise);
      add_unseen(at_whole, whole.value * element.factor, element.radius);
      if (!(whole.value < 1.0f)) share.num_inside += static_cast<int>(elements.whole_counts[mine]);
    }
    if (gpu::warp_id() == 0) noise.keep();
    __syncthreads();
  }
}

}}}  // namespace palpate::v0
