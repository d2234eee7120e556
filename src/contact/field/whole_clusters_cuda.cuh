// The clusters of a tool on a GPU: those that lie deep as one ball each (whole_cluster.h), the
// others by their elements. A lane looks after the ball of a cluster; the warp together takes the
// elements of those that need them.
#pragma once

#include "src/contact/field/ball_totals_cuda.cuh"
#include "src/contact/internal/whole_cluster.h"

namespace palpate { inline namespace v0 { namespace {

/// Number of tiles from which on a cluster counts as near without a look at them.
constexpr int kMaxTilesPerLane = 24;

/// Potential, force and torque of the elements of a cluster.
struct KeptSums {
  float potential = 0, wrench[6] = {};

  /// Takes the sums of all lanes, each of which counts its `left` of the elements.
  __device__ void keep(const FieldShare& share, float left) {
    const SumOverWarp sum;
    potential = sum(share.potential) / left;
    for (int axis = 0; axis < 3; ++axis) {
      wrench[axis] = sum(share.force[axis]) / left;
      wrench[axis + 3] = sum(share.torque[axis]) / left;
    }
  }
};

/// Adds the ball of a cluster, of which `share` counts, where the field is as given in W. Elements
/// are kept with `weight`, as the ball counts. `polar`: WholeClusters::polar, likewise. `noise` has
/// looked at the ball.
template <bool kWithStiffness, class Noise>
__device__ void add_whole(const Element& e, float polar, const Curved<float>& share,
                          const KeptSums& kept, const SpaceGradient<float>& g,
                          const Symmetric<float>& h, FieldShare& sum, StiffnessShare* sums,
                          Noise& noise) {
  const Gradient3<float> gradient{g.x, g.y, g.z};
  const float all = e.factor * (static_cast<float>(4 * kPi / 3) * e.radius * e.radius * e.radius);
  const WholeTerms<float> terms = whole_terms(share, all, g.phi, kept.potential);
  const float length = sqrtf(g.x * g.x + g.y * g.y + g.z * g.z);
  const Gradient3<float> n = bounded(gradient, length);
  const float(&l)[3] = e.lever;
  const float J[6] = {
      n.x, n.y, n.z, l[1] * n.z - l[2] * n.y, l[2] * n.x - l[0] * n.z, l[0] * n.y - l[1] * n.x};
  sum.volume += terms.volume;
  sum.potential += terms.potential;
  for (int axis = 0; axis < 3; ++axis) {
    sum.force[axis] += terms.push * J[axis];
    sum.torque[axis] += terms.push * J[axis + 3];
  }
  noise.note(l, terms.volume, 0, n);  // the volume of a ball that lies deep does not change
  if constexpr (kWithStiffness) {
    float numbers[StiffnessSums::kNum];
    stiffness_terms<float>({l[0], l[1], l[2]}, terms.push, terms.disc, share.value * polar, n,
                           bounded(h, gradient, length), numbers);
    add_exchange(share.slope, J, kept.wrench, numbers);
#pragma unroll
    for (int k = 0; k < StiffnessSums::kNum; ++k) sums->numbers[k] += numbers[k];
  }
}

/// Adds up to 32 clusters against one field: every `step`-th from `begin` on. Elements count
/// `weight` times, and as spheres if this is `counted`. Clusters that cover no more than
/// `max_tiles` tiles are left out if these are all in front. `sums` is null if Sample is a
/// Gradient. `kHasWholes`: clusters may count as one ball. `kMayBeAlone`: a warp that has one
/// cluster samples its ball by all lanes. `noise`: a NoiseKeeper or NoNoise. The whole warp calls.
template <class Sample, bool kHasWholes, bool kMayBeAlone = false, class Noise>
__device__ void add_clusters(const ElementsView& elements, const FieldLook& field, float weight,
                             bool counted, int begin, int step, int max_tiles, FieldShare& share,
                             StiffnessShare* sums, Noise& noise) {
  constexpr bool kWithStiffness = std::is_same_v<Sample, Curvature>;
  const bool is_alone = kMayBeAlone && begin + step >= elements.num_clusters;
  const int mine = begin + gpu::lane_id() * step;
  const bool is_near = mine < elements.num_clusters &&
                       !is_before_tiles(field, elements.clusters[mine],
                                        elements.largest_radius[mine], max_tiles, 0, 1);
  Element ball{};
  Gradient at_ball{};
  float whole = 0;  // share of the ball
  const int number = is_alone ? begin : mine;
  if (kHasWholes && (is_alone || is_near) && number < elements.first_ball &&
      elements.first_ball >= kMinWholes) {
    ball =
        element_of(elements.wholes[number], weight * elements.whole_factors[number], field.frame);
    if (ball.p[2] > kMinDepth) {
      const ElementLook at = look_at(field.frame, ball.p);
      at_ball = is_alone ? query_by_lanes<Gradient>(field, at, ball.radius)
                         : query_deep<Gradient>(field, at, ball.radius);
      if (is_near) whole = whole_share(at_ball.phi, elements.whole_depths[mine]).value;
    }
  }
  KeptSums kept;
  for (unsigned touching = __ballot_sync(gpu::kWholeWarp, is_near && whole < 1.0f); touching != 0;
       touching &= touching - 1) {
    const int lane = __ffs(static_cast<int>(touching)) - 1, cluster = begin + lane * step;
    const float left = kHasWholes ? 1.0f - __shfl_sync(gpu::kWholeWarp, whole, lane) : 1.0f;
    Element element = element_of(elements, cluster, field.frame);
    element.factor *= weight * left;
    element.is_counted = element.is_counted && counted;
    FieldShare of_cluster;
    if (cluster < elements.first_ball) {
      add_element<Sample>(field, element, of_cluster, sums, noise);
    } else {
      // Arguments of a call lie in memory: these do, and not those of other clusters.
      const Element of_ball = element;
      FieldShare sum;
      StiffnessShare numbers;
      Noise own = noise;
      add_ball<Sample>(field, elements.places, elements.ball_factor[cluster] * weight, of_ball, sum,
                       &numbers, own);
      of_cluster = sum;
      noise = own;
      if constexpr (kWithStiffness) {
#pragma unroll
        for (int k = 0; k < StiffnessSums::kNum; ++k) sums->numbers[k] += numbers.numbers[k];
      }
    }
    noise.keep();
    share.add(of_cluster);
    if (kHasWholes && left < 1.0f) {
      KeptSums all;
      all.keep(of_cluster, left);
      if (gpu::lane_id() == lane) kept = all;
    }
  }
  if (kHasWholes && whole > 0.0f) {
    const ElementLook at = look_at(field.frame, ball.p);
    Sample sample;
    if constexpr (kWithStiffness) {
      sample = query_deep<Sample>(field, at, ball.radius);
    } else {
      sample = at_ball;
    }
    const auto here = in_space(field.frame, at, sample);
    const SpaceGradient<float>& g = first_of(here);
    const Curved<float> part = whole_share(g.phi, elements.whole_depths[mine]);
    noise.look(field.frame, at, ball.radius);
    add_whole<kWithStiffness>(ball, weight * elements.whole_polars[mine], part, kept, g,
                              second_of(here), share, sums, noise);
    if (!(whole < 1.0f) && counted) {
      share.num_inside += static_cast<int>(elements.whole_counts[mine]);
    }
  }
  if (kHasWholes) noise.keep();
}

}}}  // namespace palpate::v0
