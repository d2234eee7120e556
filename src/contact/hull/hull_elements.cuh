// The elements of a tool against the hull on a GPU, and their sums. A block takes one cluster at a
// time: each of its warps samples some views for all its elements, and the first one joins the
// samples.
#pragma once

#include "src/contact/field/whole_clusters_cuda.cuh"
#include "src/contact/hull/hull_joins.cuh"

namespace palpate { inline namespace v0 { namespace {

constexpr int kHullWarps = 8, kHullThreads = kHullWarps * gpu::kWarpSize;
constexpr int kWholeThreads = kHullThreads + gpu::kWarpSize;  // of add_hull_cluster

// Samples of the views for the elements of a cluster, and `kMoreRows` others.
template <int kMaxViews, class Sample, int kMoreRows = 0>
struct ViewScratch {
  static constexpr int kNum = sizeof(InSpace<Sample>) / sizeof(float);

  float numbers[2 * kMaxViews + kMoreRows][kNum][gpu::kWarpSize];
  float wholes[gpu::kWarpSize];
  int is_free, queries_memory[2];

  __device__ void store(int row, const InSpace<Sample>& said) {
    const float* const from = reinterpret_cast<const float*>(&said);
    for (int i = 0; i < kNum; ++i) numbers[row][i][gpu::lane_id()] = from[i];
  }
  __device__ InSpace<Sample> load(int row, int lane) const {
    InSpace<Sample> said;
    float* const to = reinterpret_cast<float*>(&said);
    for (int i = 0; i < kNum; ++i) to[i] = numbers[row][i][lane];
    return said;
  }
};

// The same where one more warp looks after the ball of the cluster: rows for what its lanes sample,
// a view each, and for the fields joined by two warps.
template <int kMaxViews, class Sample>
struct WholeScratch : ViewScratch<kMaxViews, Sample, 3> {
  // The cluster as one ball, and what the hull is there.
  ElementBall ball;
  float depth, factor, polar, count;
  Joined<InSpace<Sample>> at;
};

/// Samples the hull for the ball of each lane, the same in all warps; the first warp returns its
/// values. In a WholeScratch one warp more has a ball of its own and returns the value there. The
/// whole block calls. `in_front`: see queries_in_front, of a view.
template <class Sample, int kMaxViews, class InFront, class Scratch>
__device__ Joined<InSpace<Sample>> query_hull(const HullQuery<kMaxViews>& query,
                                              const PosedTool<kMaxViews>& tool, const Ball& ball,
                                              const InFront& in_front, Scratch& views) {
  using Space = InSpace<Sample>;
  constexpr bool kWithWhole = std::is_same_v<Scratch, WholeScratch<kMaxViews, Sample>>;
  constexpr int kWhole = 2 * kMaxViews, kFields = kWhole + 1;  // rows
  static_assert(2 * kMaxViews <= gpu::kWarpSize, "a lane for each view of the ball");
  const bool is_whole = kWithWhole && gpu::warp_id() == kHullWarps;
  const bool joins = gpu::warp_id() == 0 || is_whole;
  const auto sample = [&](const auto& of_view) {
    const int step = is_whole ? gpu::kWarpSize : kHullWarps;
    for (int view = is_whole ? gpu::lane_id() : gpu::warp_id(); view < num_views(query);
         view += step) {
      views.store(is_whole ? kWhole : view, of_view(view));
    }
    __syncthreads();
  };
  const auto said_to = [&](bool whole) {
    return [&views, whole](int view) {
      return whole ? views.load(kWhole, view) : views.load(view, gpu::lane_id());
    };
  };
  const auto said = said_to(is_whole);
  sample([&](int view) { return query_view<Sample>(query, tool, view, ball, in_front(view)); });
  Joined<Space> at_ball{};
  typename Joined<Space>::Least fields;
  if (joins) at_ball = join_seen<Space>(query, ball.radius, said);
  if constexpr (kWithWhole) {
    // Two other warps join the fields meanwhile, whether anybody needs them or not.
    const int other = gpu::warp_id() - 1;
    if ((other == 0 || other == 1) && !query.is_alone) {
      const float radius = other == 0 ? ball.radius : views.ball.radius;
      views.store(kFields + other, join_fields<Space>(query, radius, said_to(other == 1)).value);
    }
    __syncthreads();
    if (joins) fields.value = views.load(kFields + (is_whole ? 1 : 0), gpu::lane_id());
  } else if (joins && needs_wider(query, at_ball, ball.extent)) {
    fields = join_fields<Space>(query, ball.radius, said);
  }
  if (query.has_memory) {
    // Samples of memories replace those of the views, if any element needs them.
    const bool needs_memory = joins && needs_wider(query, at_ball, ball.extent);
    const bool any = __any_sync(gpu::kWholeWarp, needs_memory);
    if (joins && gpu::lane_id() == 0) views.queries_memory[is_whole ? 1 : 0] = any;
    __syncthreads();
    if (views.queries_memory[0] != 0 || (kWithWhole && views.queries_memory[1] != 0)) {
      sample([&](int view) { return query_memory<Sample>(query, tool, view, ball); });
      if (needs_memory) join_memories<Space>(query, ball.radius, said, at_ball);
    }
  }
  if (joins && needs_wider(query, at_ball, ball.extent)) {
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

__device__ inline void add_unseen(bool is_unseen, float factor, float radius, FieldShare& share) {
  if (!is_unseen) return;
  share.unseen += factor * (static_cast<float>(4 * kPi / 3) * radius * radius * radius);
}

/// Returns the ball of this lane in a cluster.
__device__ inline Ball ball_of(const ElementsView& elements, int cluster) {
  const ElementBall at = elements.balls[cluster * SphereClusters::kSize + gpu::lane_id()];
  const bool is_part = cluster >= elements.first_ball && gpu::lane_id() < kNumBallParts;
  return {at.x, at.y, at.z, at.radius, (is_part ? kPartExtent : 1.0f) * at.radius};
}

/// Adds the element of each lane by its value of the hull. `ball`: its ball. The first warp calls.
template <bool kWithStiffness, int kMaxViews, class Space, class Noise>
__device__ void add_cluster(const HullQuery<kMaxViews>& query, const PosedTool<kMaxViews>& tool,
                            int cluster, const Element& element, const Ball& ball,
                            const Joined<Space>& at_ball, FieldShare& of_cluster, FieldShare& share,
                            StiffnessShare& stiffness, Noise& noise) {
  const ElementsView& elements = tool.elements;
  add_unseen(at_ball.is_unseen(), element.factor, ball.radius, share);
  const SpaceGradient<float>& g = first_of(at_ball.hull);
  const bool is_touching = g.phi < ball.radius;
  const Symmetric<float> h = second_of(at_ball.hull);
  look_from_decider(query, tool, at_ball.decider, ball, noise);
  if (cluster >= elements.first_ball) {
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
      const Ball ball = ball_of(elements, cluster);
      const Joined<InSpace<Sample>> at_ball = query_hull<Sample>(
          query, tool, ball, [&](int view) { return queries_in_front(query, tool, view, cluster); },
          views);
      if (gpu::warp_id() != 0) continue;
      Element element = element_of(elements, cluster, tool.in_world);
      element.factor *= left;
      FieldShare of_cluster;
      add_cluster<kWithStiffness>(query, tool, cluster, element, ball, at_ball, of_cluster, share,
                                  stiffness, noise);
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
      add_unseen(at_whole.is_unseen(), whole.value * element.factor, element.radius, share);
      if (!(whole.value < 1.0f)) share.num_inside += static_cast<int>(elements.whole_counts[mine]);
    }
    if (gpu::warp_id() == 0) noise.keep();
    __syncthreads();
  }
}

/// Adds one cluster: its elements and the ball that stands for it at once, as one query has time
/// for little else. The bits are those of add_hull_elements. A whole block calls, of kWholeThreads.
template <int kMaxViews, class Sample>
__device__ void add_hull_cluster(const HullQuery<kMaxViews>& query,
                                 const PosedTool<kMaxViews>& tool, int cluster,
                                 WholeScratch<kMaxViews, Sample>& views, FieldShare& share,
                                 StiffnessShare& stiffness) {
  constexpr bool kWithStiffness = std::is_same_v<Sample, Curvature>;
  const ElementsView& elements = tool.elements;
  const bool has_whole = cluster < elements.first_ball && elements.first_ball >= kMinWholes;
  Ball ball = ball_of(elements, cluster);
  // Numbers that are added last are read now.
  const float factor = elements.factors[cluster * SphereClusters::kSize + gpu::lane_id()];
  const bool is_whole = gpu::warp_id() == kHullWarps;
  if (is_whole && has_whole) {
    const ElementBall of = elements.wholes[cluster];
    ball = {of.x, of.y, of.z, of.radius, of.radius};
    if (gpu::lane_id() == 0) {
      views.depth = elements.whole_depths[cluster];
      views.factor = elements.whole_factors[cluster];
      views.polar = elements.whole_polars[cluster];
      views.count = elements.whole_counts[cluster];
    }
  }
  if (is_whole && gpu::lane_id() == 0) views.ball = {ball.x, ball.y, ball.z, ball.radius};
  const Joined<InSpace<Sample>> at = query_hull<Sample>(
      query, tool, ball,
      [&](int view) {
        return is_whole ? query.eyes[eye_of(query, view)].has_in_front
                        : queries_in_front(query, tool, view, cluster);
      },
      views);
  if (is_whole && gpu::lane_id() == 0) views.at = at;
  __syncthreads();
  if (gpu::warp_id() == 0) {
    NoNoise noise;
    KeptSums kept;
    const Joined<InSpace<Sample>> at_whole = views.at;
    const Curved<float> whole =
        has_whole ? whole_share(first_of(at_whole.hull).phi, views.depth) : Curved<float>{};
    const float left = 1.0f - whole.value;
    if (left > 0.0f) {
      Element element =
          element_of(ElementBall{ball.x, ball.y, ball.z, ball.radius}, factor, tool.in_world);
      element.factor *= left;
      FieldShare of_cluster;
      add_cluster<kWithStiffness>(query, tool, cluster, element, ball, at, of_cluster, share,
                                  stiffness, noise);
      if (left < 1.0f) kept.keep(of_cluster, left);
    }
    if (whole.value > 0.0f && gpu::lane_id() == 0) {
      const Element element = element_of(views.ball, views.factor, tool.in_world);
      add_whole<kWithStiffness>(element, views.polar, whole, kept, first_of(at_whole.hull),
                                second_of(at_whole.hull), share, &stiffness, noise);
      add_unseen(at_whole.is_unseen(), whole.value * element.factor, element.radius, share);
      if (!(whole.value < 1.0f)) share.num_inside += static_cast<int>(views.count);
    }
  }
  __syncthreads();
}

}}}  // namespace palpate::v0
