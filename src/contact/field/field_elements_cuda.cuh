// Samples of a depth field at the elements of a tool on a GPU, and their sums.
#pragma once

#include <type_traits>

#include "src/contact/cuda/query_answer.h"
#include "src/contact/field/field_tool_cuda.h"
#include "src/contact/internal/ball_cut.h"
#include "src/contact/internal/hull_rules.h"
#include "src/gpu/internal/team.cuh"

namespace palpate { inline namespace v0 {
static_assert(SphereClusters::kSize == gpu::kWarpSize);

// A field as kernels read it: constants of all levels, and the arrays of each.
struct FieldLook {
  const float* planes = nullptr;  // of level 0; the other levels follow
  const Silhouette* silhouettes = nullptr;
  const std::uint8_t* near_silhouette = nullptr;
  const DepthTile* tiles = nullptr;
  std::int32_t tiles_wide = 0, tiles_high = 0;
  std::int32_t start[DepthFieldView::kMaxLevels] = {};  // pixel (0, 0) of each level
  std::int32_t stride = 0, last_level = -1;             // -1: no field
  float width = 0, height = 0, thickness = 0;
  FieldFrame frame;
  float weight = 0;
};

inline FieldLook look_of(const DepthFieldView& view, const FieldFrame& frame, double weight) {
  FieldLook look;
  look.frame = frame;
  if (view.num_levels == 0) return look;
  const DepthFieldLevel& finest = view.levels[0];
  look.planes = finest.planes;
  look.silhouettes = finest.silhouettes;
  look.near_silhouette = finest.near_silhouette;
  for (int k = 0; k < view.num_levels; ++k) {
    look.start[k] =
        static_cast<std::int32_t>(view.levels[k].near_silhouette - finest.near_silhouette);
  }
  look.stride = finest.stride;
  look.last_level = view.num_levels - 1;
  look.width = static_cast<float>(finest.width);
  look.height = static_cast<float>(finest.height);
  look.thickness = view.thickness;
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

__device__ inline float scale_of(int level) {
  return __int_as_float((127 - level) << 23);
}  // 2^-level

__device__ inline DepthFieldLevel level_of(const FieldLook& field, int number) {
  const int start = field.start[number];
  DepthFieldLevel level;
  level.planes = field.planes + 2 * std::ptrdiff_t{start};
  level.silhouettes = field.silhouettes + 2 * std::ptrdiff_t{start};
  level.near_silhouette = field.near_silhouette + start;
  level.stride = field.stride;
  level.scale = scale_of(number);
  level.last_u = field.width * level.scale - DepthFieldLevel::kFirst;
  level.last_v = field.height * level.scale - DepthFieldLevel::kFirst;
  return level;
}

// Level and blend for a footprint = m 2^e with m in [1, 2), as the vector kernel chooses them:
// between levels e and e + 1.
__device__ inline LevelChoice<float> choose(float footprint, int last_level, float inverse_depth) {
  const int bits = __float_as_int(footprint < 1.0f ? 1.0f : footprint);
  const int exponent = (bits >> 23) - 127;
  const float m = __int_as_float((bits & 0x7fffff) | 0x3f800000);
  const float x = (m - 1.0f) * (1.0f / (kBlendEnd - 1));
  const Sloped<float> step = smooth_step(x);
  LevelChoice<float> choice;
  choice.level = last_level;
  if (exponent >= last_level) return choice;
  const bool is_next = step.value >= 1.0f;
  choice.level = exponent + is_next;
  if (!is_next) {
    const float x_by_z = m * inverse_depth * (-1.0f / (kBlendEnd - 1));
    choice.blend = {step.value, step.slope * x_by_z};
    const float bend = x > 0.0f && x < 1.0f ? 6.0f - 12.0f * x : 0.0f;
    choice.blend_by_zz = x_by_z * (bend * x_by_z - 2.0f * step.slope * inverse_depth);
  }
  return choice;
}

__device__ inline const Gradient& first_of(const Gradient& g) { return g; }
__device__ inline const Gradient& first_of(const Curvature& c) { return c.first; }

// Samples a sphere of this radius on the one or two levels of its size. `Sample` is a Gradient or a
// Curvature.
template <class Sample>
__device__ Sample query_field(const FieldLook& field, float u, float v, float depth,
                              float inverse_depth, float radius) {
  const LevelChoice<float> choice =
      choose(kFootprint * radius * field.frame.fx * inverse_depth, field.last_level, inverse_depth);
  Sample answer{};
  LevelChoice<float> part;  // of the next sample
  part.blend = {1, 0};
#pragma unroll 1
  for (int number = choice.level;; ++number) {
    const DepthFieldLevel level = level_of(field, number);
    const PixelSpot<float> spot = spot_at(level, u, v);
    Curved<float> values[3][3];
    constexpr bool kIsCurvature = std::is_same_v<Sample, Curvature>;
    values_around<kIsCurvature ? 1 : 3>(level, spot.pixel, depth, field.thickness, field.frame.fx,
                                        values);
    if constexpr (kIsCurvature) {
      answer = blended(answer, curvature_of(values, spot.s, spot.t, level.scale), part.blend.value,
                       part.blend.slope, part.blend_by_zz);
    } else {
      answer = mixed(answer, gradient_of(values, spot.s, spot.t, level.scale), part.blend.value,
                     part.blend.slope);
    }
    if (number > choice.level || !(choice.blend.value > 0)) break;
    part = choice;
  }
  return answer;
}

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
  look.inverse_depth = 1.0f / look.depth;
  look.from_u = frame.fx * p[0] * look.inverse_depth;
  look.from_v = frame.fy * p[1] * look.inverse_depth;
  look.u = look.from_u + frame.cx;
  look.v = look.from_v + frame.cy;
  return look;
}

// Samples a sphere of this radius, and wider ones if it lies deep.
template <class Sample>
__device__ Sample query_deep(const FieldLook& field, const ElementLook& at, float radius) {
  Sample answer{};
  float requested = radius;
#pragma unroll 1
  for (int step = 0;; ++step) {
    const Sample here =
        query_field<Sample>(field, at.u, at.v, at.depth, at.inverse_depth, requested);
    if (step > 0) {
      const float finer = requested * (1.0f / kDeepGrowth);
      answer = deepened(answer, here, first_of(answer).phi, first_of(here).phi, finer);
    } else {
      answer = here;
    }
    if (step == kMaxDeepSteps || !(first_of(answer).phi < -deep_limit(requested))) break;
    requested *= kDeepGrowth;
  }
  return answer;
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

// Adds an element that touches a surface.
template <bool kWithStiffness>
__device__ inline void add_cut(const Element& e, float phi, const Gradient3<float>& gradient,
                               const Symmetric<float>& h, FieldShare& sum, StiffnessShare* sums) {
  add_cut<kWithStiffness>(e, phi, cut_ball(e.radius, e.factor, phi),
                          cut_area(e.radius, e.factor, phi), gradient, h, sum, sums);
  if (e.is_counted) ++(phi <= -e.radius ? sum.num_inside : sum.num_boundary);
}

// Adds an element against one field. `sums` is null if Sample is a Gradient.
template <class Sample>
__device__ void add_element(const FieldLook& field, const Element& e, FieldShare& sum,
                            StiffnessShare* sums) {
  constexpr bool kWithStiffness = std::is_same_v<Sample, Curvature>;
  if (!(e.p[2] > kMinDepth)) return;
  const ElementLook at = look_at(field.frame, e.p);
  if constexpr (kWithStiffness) {
    // Few elements touch the surface, and only their second derivatives are computed.
    if (!(query_field<Gradient>(field, at.u, at.v, at.depth, at.inverse_depth, e.radius).phi <
          e.radius)) {
      return;
    }
  }
  const Sample answer = query_deep<Sample>(field, at, e.radius);
  const Gradient& g = first_of(answer);
  if (!(g.phi < e.radius)) return;
  const Gradient3<float> gradient =
      to_space(g, at.from_u, at.from_v, at.inverse_depth, field.frame.fx, field.frame.fy);
  Symmetric<float> h{};
  if constexpr (kWithStiffness) {
    h = hessian_in_space(answer, at.from_u, at.from_v, at.inverse_depth, field.frame.fx,
                         field.frame.fy);
  }
  add_cut<kWithStiffness>(e, g.phi, gradient, h, sum, sums);
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
