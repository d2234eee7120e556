// Samples of a depth field at the elements of a tool on a GPU, and their sums.
#pragma once

#include <cstring>
#include <type_traits>

#include "src/contact/cuda/query_answer.h"
#include "src/contact/field/field_tool_cuda.h"
#include "src/contact/internal/ball_cut.h"
#include "src/contact/internal/hull_rules.h"
#include "src/contact/noise/noise_keeper.cuh"
#include "src/field/internal/deep_query.h"
#include "src/gpu/internal/team.cuh"

namespace palpate { inline namespace v0 {
static_assert(SphereClusters::kSize == gpu::kWarpSize);

// A field as kernels read it, with the tool in its camera. No levels: no field.
struct FieldLook {
  FieldPixels pixels;
  const DepthTile* tiles = nullptr;
  std::int32_t tiles_wide = 0, tiles_high = 0;
  FieldGrid grid;
  FieldFrame frame;
  float weight = 0;
};

inline FieldLook look_of(const DepthFieldView& view, const FieldFrame& frame, double weight) {
  FieldLook look;
  look.frame = frame;
  if (view.num_levels == 0) return look;
  look.pixels = pixels_of(view);
  look.grid = grid_of(view);
  look.tiles = view.tiles;
  look.tiles_wide = view.tiles_wide;
  look.tiles_high = view.tiles_high;
  look.weight = static_cast<float>(weight);
  return look;
}

namespace {

using Gradient = ImageGradient<float>;
using Curvature = ImageCurvature<float>;

/// Threads of a block, at most.
template <class Sample>
inline constexpr int kThreadsOf = std::is_same_v<Sample, Curvature> ? 128 : 256;

// Sums of one thread, which has few elements.
struct FieldShare {
  float volume = 0, potential = 0;
  float force[3] = {}, torque[3] = {};
  float unseen = 0;
  int num_boundary = 0, num_inside = 0;

  __device__ void add(const FieldShare& other) {
    volume += other.volume;
    potential += other.potential;
    for (int axis = 0; axis < 3; ++axis) {
      force[axis] += other.force[axis];
      torque[axis] += other.torque[axis];
    }
    unseen += other.unseen;
    num_boundary += other.num_boundary;
    num_inside += other.num_inside;
  }
};

// Likewise, of StiffnessSums.
struct StiffnessShare {
  float numbers[StiffnessSums::kNum] = {};
};

// Position and weight of an element.
struct Element {
  float lever[3], p[3];  // from C and from the camera, in W
  float radius, factor;
  bool is_counted;
};

__device__ inline Element element_of(const ElementBall& ball, float factor,
                                     const FieldFrame& frame) {
  Element element;
  element.radius = ball.radius;
  element.factor = fabsf(factor);
  element.is_counted = __float_as_int(factor) >= 0;
  for (int row = 0; row < 3; ++row) {
    const float(&r)[3] = frame.R_WT[row];
    element.lever[row] = r[0] * ball.x + r[1] * ball.y + r[2] * ball.z;
    element.p[row] = element.lever[row] + frame.p_WC[row];
  }
  return element;
}

/// Returns the element of this lane in a cluster.
__device__ inline Element element_of(const ElementsView& elements, int cluster,
                                     const FieldFrame& frame) {
  const int slot = cluster * SphereClusters::kSize + gpu::lane_id();
  return element_of(elements.balls[slot], elements.factors[slot], frame);
}

// Image of an element.
struct ElementLook {
  float depth, inverse_depth, from_u, from_v, u, v;
};
__device__ inline ElementLook look_at(const FieldFrame& frame, const float (&p)[3]) {
  ElementLook look;
  look.depth = p[2];
  look.inverse_depth = __frcp_rn(look.depth);
  look.from_u = frame.fx * p[0] * look.inverse_depth;
  look.from_v = frame.fy * p[1] * look.inverse_depth;
  look.u = look.from_u + frame.cx;
  look.v = look.from_v + frame.cy;
  return look;
}

// Samples a sphere of this radius, and wider ones if it lies deep.
template <class Sample>
__device__ Sample query_deep(const FieldLook& field, const ElementLook& at, float radius) {
  return query_deep<OneLane<float>, Sample>(field.grid, field.pixels, at.u, at.v, at.depth,
                                            at.inverse_depth, radius);
}

// Returns the sample of another lane. The whole warp calls.
template <class Sample>
__device__ Sample sample_of(const Sample& mine, int lane) {
  float numbers[sizeof(Sample) / sizeof(float)];
  memcpy(numbers, &mine, sizeof mine);
  for (float& number : numbers) number = __shfl_sync(gpu::kWholeWarp, number, lane);
  Sample other;
  memcpy(&other, numbers, sizeof other);
  return other;
}

// Samples one sphere, the same in all lanes: each level of each of the spheres that it may need by
// a lane of its own. The whole warp calls.
template <class Sample>
__device__ Sample query_by_lanes(const FieldLook& field, const ElementLook& at, float radius) {
  using Lane = OneLane<float>;
  static_assert(2 * (kMaxDeepSteps + 1) <= gpu::kWarpSize);
  const int lane = gpu::lane_id(), step = lane / 2;
  LevelSteps<Lane, float> steps(field.grid, radius, at.inverse_depth);
  steps.go_on(field.grid, step < kMaxDeepSteps ? step : kMaxDeepSteps);
  const LevelChoice<Lane>& levels = steps.levels;
  const int level = lane % 2 == 0 ? levels.level : levels.wider;
  Sample here = sample_level<Lane, Sample>(
      field.grid, field.pixels, spot_at<Lane>(field.grid, at.u, at.v, level), level, at.depth);
  const Sample wider = sample_of(here, lane ^ 1);
  if (levels.blend() > 0) here = with_wider(here, wider, levels, at.inverse_depth);
  return deepest<Sample>(radius, [&](int k) { return sample_of(here, 2 * k); });
}

// Adds an element cut at `phi` whose volume shrinks by `disc` phi: the field has this gradient
// there and, if `kWithStiffness`, these second derivatives in W. Returns the gradient that the
// force follows.
template <bool kWithStiffness>
__device__ inline Gradient3<float> add_cut(const Element& e, float phi, const CutBall<float>& cut,
                                           float disc, const Gradient3<float>& gradient,
                                           const Symmetric<float>& h, FieldShare& sum,
                                           StiffnessShare* sums) {
  const float length =
      sqrtf(gradient.x * gradient.x + gradient.y * gradient.y + gradient.z * gradient.z);
  const Gradient3<float> n = bounded(gradient, length);
  const float force[3] = {cut.volume * n.x, cut.volume * n.y, cut.volume * n.z};
  sum.volume += cut.volume;
  sum.potential += cut.potential;
  for (int a = 0; a < 3; ++a) {
    const int b = (a + 1) % 3, c = (a + 2) % 3;
    sum.force[a] += force[a];
    sum.torque[a] += e.lever[b] * force[c] - e.lever[c] * force[b];
  }
  if constexpr (kWithStiffness) {
    float terms[StiffnessSums::kNum];
    stiffness_terms<float>({e.lever[0], e.lever[1], e.lever[2]}, cut.volume, disc,
                           polar_moment<float>(e.radius, e.factor, phi), n,
                           bounded(h, gradient, length), terms);
#pragma unroll
    for (int k = 0; k < StiffnessSums::kNum; ++k) sums->numbers[k] += terms[k];
  }
  return n;
}

// Adds an element that touches a surface, where `noise` has looked at it.
template <bool kWithStiffness, class Noise>
__device__ inline void add_cut(const Element& e, float phi, const Gradient3<float>& gradient,
                               const Symmetric<float>& h, FieldShare& sum, StiffnessShare* sums,
                               Noise& noise) {
  const CutBall<float> cut = cut_ball(e.radius, e.factor, phi);
  const float disc = cut_area(e.radius, e.factor, phi);
  const Gradient3<float> n = add_cut<kWithStiffness>(e, phi, cut, disc, gradient, h, sum, sums);
  noise.note(e.lever, cut.volume, disc, n);
  if (e.is_counted) ++(phi <= -e.radius ? sum.num_inside : sum.num_boundary);
}

// Adds an element by its sample, if it touches. `sums` is null if Sample is a Gradient.
template <class Sample, class Noise>
__device__ void add_sample(const FieldLook& field, const Element& e, const ElementLook& at,
                           const Sample& sample, FieldShare& sum, StiffnessShare* sums,
                           Noise& noise) {
  if (!(first_of(sample).phi < e.radius)) return;
  const auto here = in_space(field.frame, at, sample);
  const SpaceGradient<float>& g = first_of(here);
  noise.look(field.frame, at, e.radius);
  add_cut<std::is_same_v<Sample, Curvature>>(e, g.phi, {g.x, g.y, g.z}, second_of(here), sum, sums,
                                             noise);
}

// Adds an element against one field. `sums` is null if Sample is a Gradient.
template <class Sample, class Noise>
__device__ void add_element(const FieldLook& field, const Element& e, FieldShare& sum,
                            StiffnessShare* sums, Noise& noise) {
  if (!(e.p[2] > kMinDepth)) return;
  const ElementLook at = look_at(field.frame, e.p);
  add_sample(field, e, at, query_deep<Sample>(field, at, e.radius), sum, sums, noise);
}

/// Adds the sums of a thread.
__device__ inline void add_share(const FieldShare& share, MeasureTerms& to) {
  to.volume += share.volume;
  to.potential += share.potential;
  for (int axis = 0; axis < 3; ++axis) {
    to.force[axis] += share.force[axis];
    to.torque[axis] += share.torque[axis];
  }
  to.unseen += share.unseen;
  to.num_boundary += share.num_boundary;
  to.num_inside += share.num_inside;
}

/// True if no element in a ball is near the surface, by every `step`-th tile of those it covers
/// from tile `first` on. False if there are more than `max_tiles`.
__device__ inline bool is_before_tiles(const FieldLook& field, const Cluster& ball,
                                       float largest_radius, int max_tiles, int first, int step) {
  const BallWindow window =
      window_of(field.frame, ball, largest_radius, field.tiles_wide, field.tiles_high);
  if (!window.is_before_camera()) return window.farthest < kMinDepth;
  const int wide = window.right - window.left + 1;
  if (wide * (window.bottom - window.top + 1) > max_tiles) return false;
  int v = window.top + first / wide, u = window.left + first % wide;
  while (v <= window.bottom) {
    if (!is_behind(field.tiles[v * field.tiles_wide + u], window.farthest, largest_radius)) {
      return false;
    }
    for (u += step; u > window.right; u -= wide) ++v;
  }
  return true;
}

/// The same by all tiles. Every lane of the warp reads some of them.
__device__ inline bool is_in_front(const FieldLook& field, const Cluster& ball,
                                   float largest_radius, int max_tiles = 1 << 30) {
  return __all_sync(gpu::kWholeWarp, is_before_tiles(field, ball, largest_radius, max_tiles,
                                                     gpu::lane_id(), gpu::kWarpSize));
}

}  // namespace
}}  // namespace palpate::v0
