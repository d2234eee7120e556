// Sums of a ball in thirty parts on a GPU: its parts, corrected by a plane (ball_cut.h), as the
// elements of a warp.
#pragma once

#include "src/contact/field/field_elements_cuda.cuh"

namespace palpate { inline namespace v0 { namespace {

// Adds up the numbers of a warp, in the order of SumOfRow.
struct SumOverWarp {
  __device__ float operator()(float number) const {
#pragma unroll
    for (int half = gpu::kWarpSize / 2; half > 0; half /= 2) {
      number += __shfl_xor_sync(gpu::kWholeWarp, number, half);
    }
    return number;
  }
};

// Adds a ball in parts, the elements of a warp, which counts `count` times, corrected by a plane if
// every part has a value. The field is `phi` at each, with this gradient and these second
// derivatives in W.
template <bool kWithStiffness, class Noise>
__device__ __noinline__ void add_ball(const float* places, float count, const Element& e, float phi,
                                      bool is_touching, bool is_complete,
                                      const Gradient3<float>& gradient, const Symmetric<float>& h,
                                      FieldShare& sum, StiffnessShare* sums, Noise& noise) {
  constexpr int kSize = SphereClusters::kSize;
  constexpr bool kWithForms = kWithStiffness || Noise::kWants;
  const SumOverWarp over_warp;
  const int lane = gpu::lane_id();
  const float* const at = places + lane;
  const BallRows<float> part{at[0], at[kSize], at[2 * kSize], at[3 * kSize]};
  const float radius = __shfl_sync(gpu::kWholeWarp, e.radius, kNumBallParts);
  BallPlane<float, float> plane;
  if (__all_sync(gpu::kWholeWarp, is_complete)) {
    plane = ball_plane<float>(part, phi * (1.0f / radius), over_warp, kWithForms);
  }
  const float twice = count * radius * radius, thrice = twice * radius;
  const bool counts = is_touching || plane.is_plane;
  const float touching = is_touching ? phi : e.radius;
  CutBall<float> cut = cut_ball(e.radius, e.factor, touching);
  cut.volume += thrice * plane.volume;
  if (lane == 0) cut.potential += thrice * radius * plane.potential;
  const float disc = cut_area(e.radius, e.factor, touching) + twice * plane.disc * part.is_part;
  Gradient3<float> n{};
  if (counts) {
    n = add_cut<kWithStiffness>(e, touching, cut, disc, gradient, h, sum, sums);
    if (is_touching && e.is_counted) ++(phi <= -e.radius ? sum.num_inside : sum.num_boundary);
  }
  if constexpr (kWithForms) {
    float weights[5] = {};
    if (plane.is_plane) form_weights(part, plane.residual, weights);
    const float changes[6] = {n.x,
                              n.y,
                              n.z,
                              e.lever[1] * n.z - e.lever[2] * n.y,
                              e.lever[2] * n.x - e.lever[0] * n.z,
                              e.lever[0] * n.y - e.lever[1] * n.x};
    if constexpr (Noise::kWants) {
      float by_field[kNumChanges];
      set_ball_changes(plane, twice, weights, part.is_part, changes, disc, over_warp, by_field);
      noise.note({e.lever[0], e.lever[1], e.lever[2]}, cut.volume, by_field, n);
    }
    if constexpr (kWithStiffness) {
      if (!plane.is_plane) return;
      float X[5][6];
      for (int i = 0; i < 5; ++i) {
        for (int k = 0; k < 6; ++k) X[i][k] = over_warp(weights[i] * changes[k]);
      }
      if (lane == 0) add_form(plane.form, X, twice, sums->numbers);
    }
  }
}

// Adds a ball in parts by the samples of its parts. The whole warp calls.
template <class Sample, class Noise>
__device__ void add_ball(const FieldLook& field, const float* places, float count, const Element& e,
                         const ElementLook& at, const Sample& sample, FieldShare& sum,
                         StiffnessShare* sums, Noise& noise) {
  const bool is_before_camera = e.p[2] > kMinDepth;
  auto here = in_space(field.frame, at, sample);
  // Values far off are limited, as in the depth hull.
  const float extent = (gpu::lane_id() < kNumBallParts ? kPartExtent : 1.0f) * e.radius;
  here = composed(limited(first_of(here).phi, e.radius, extent), here);
  const SpaceGradient<float>& first = first_of(here);
  noise.look(field.frame, at, e.radius);
  add_ball<std::is_same_v<Sample, Curvature>>(
      places, count, e, first.phi, is_before_camera && first.phi < e.radius, is_before_camera,
      {first.x, first.y, first.z}, second_of(here), sum, sums, noise);
}

// Looks at an element, also at one that is not before the camera.
__device__ inline ElementLook look_before(const FieldFrame& frame, const Element& e) {
  const float p[3] = {e.p[0], e.p[1], e.p[2] > kMinDepth ? e.p[2] : kMinDepth};
  return look_at(frame, p);
}

// Adds a ball in parts against one field. The whole warp calls.
template <class Sample, class Noise>
__device__ void add_ball(const FieldLook& field, const float* places, float count, const Element& e,
                         FieldShare& sum, StiffnessShare* sums, Noise& noise) {
  const ElementLook at = look_before(field.frame, e);
  add_ball(field, places, count, e, at, query_deep<Sample>(field, at, e.radius), sum, sums, noise);
}

}}}  // namespace palpate::v0
