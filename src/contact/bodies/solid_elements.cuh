// Elements of a body that sample the distance field of another one, on a GPU: a warp for a cluster.
#pragma once

#include <type_traits>

#include "src/contact/bodies/solid_contact.h"
#include "src/contact/field/field_elements_cuda.cuh"

namespace palpate { inline namespace v0 {

/// One direction of sampling, whatever the poses.
struct SolidWay {
  ElementsView elements;
  const std::int32_t* level = nullptr;  // as in SolidSampling
  const float* rounding = nullptr;
  SolidFieldView field;
};

/// Copies a direction to the GPU; `memory` owns it and keeps failures.
inline SolidWay way_on_gpu(const FieldElements& elements, const SolidSampling& sampling,
                           const SolidField& field, gpu::Memory& memory) {
  SolidWay way{elements_view(elements, memory), memory.copy_of(sampling.level),
               memory.copy_of(sampling.rounding), view_of(field)};
  way.field.values = memory.copy_of(field.values());
  return way;
}

namespace {

using SolidSlope = SolidGradient<float>;
using SolidBend = SolidCurvature<float>;

/// Samples at p, from the corner of the grids. False if the grid has no node there.
template <class Sample>
__device__ bool sample_level(const SolidFieldView& field, const float (&p)[3], int level,
                             Sample& sample) {
  const float per_spacing = 1.0f / (field.spacing * static_cast<float>(1 << level));
  std::int32_t at = 0;
  float off[3];
  bool is_inside = true;
#pragma unroll
  for (int axis = 2; axis >= 0; --axis) {
    const std::int32_t num = field.num_nodes[axis][level];
    const float desired = p[axis] * per_spacing + static_cast<float>(SolidField::kMargin);
    const float place = fminf(fmaxf(desired, 1.0f), static_cast<float>(num - 2));
    is_inside = is_inside && place == desired;
    const auto node = static_cast<std::int32_t>(place + 0.5f);
    off[axis] = place - static_cast<float>(node);
    at = at * num + node;
  }
  const std::int32_t row = field.num_nodes[0][level], slice = row * field.num_nodes[1][level];
  const float* const first = field.values + field.first[level] + at - slice - row - 1;
  sample_spline(
      off[0], off[1], off[2], per_spacing,
      [&](int j, int k, float(&nodes)[3]) {
        const float* const from = first + k * slice + j * row;
        for (int i = 0; i < 3; ++i) nodes[i] = from[i];
      },
      sample);
  return is_inside;
}

template <class Sample>
constexpr bool kIsCurvature = std::is_same_v<Sample, SolidCurvature<float>>;
template <class Sample>
__device__ void add_solid_element(const SolidWay& way, const SolidFrame& frame, int cluster,
                                  FieldShare& share, StiffnessShare& stiffness) {
  const int slot = cluster * SphereClusters::kSize + gpu::lane_id();
  const ElementBall ball = way.elements.balls[slot];
  const auto rotated = [&](const float(&row)[3]) {
    return row[0] * ball.x + row[1] * ball.y + row[2] * ball.z;
  };
  float p[3];
  for (int axis = 0; axis < 3; ++axis) {
    p[axis] = rotated(frame.R_FE[axis]) + frame.p_FC[axis];
  }
  Sample sample;
  const bool is_inside = sample_level(way.field, p, way.level[slot], sample);
  const SolidGradient<float>& g = first_of(sample);
  if (!is_inside || !(g.phi < ball.radius)) return;
  Element e;
  for (int axis = 0; axis < 3; ++axis) {
    e.lever[axis] = rotated(frame.R_WE[axis]);
    e.p[axis] = 0;
  }
  const float factor = way.elements.factors[slot];
  e.radius = ball.radius;
  e.factor = fabsf(factor);
  e.is_counted = __float_as_int(factor) >= 0;
  const float(&R)[3][3] = frame.R_WF;
  const Gradient3<float> n = turned(R, g.n);
  Symmetric<float> h{};
  if constexpr (kIsCurvature<Sample>) h = turned(R, sample.h);
  NoNoise noise;  // a CAD model has none
  add_cut<kIsCurvature<Sample>>(e, g.phi, n, h, share, &stiffness, noise);
}

/// Adds every `step`-th cluster from `first` on. The whole warp calls.
template <class Sample>
__device__ void add_solid_elements(const SolidWay& way, const SolidFrame& frame, int first,
                                   int step, FieldShare& share, StiffnessShare& stiffness) {
  for (int cluster = first; cluster < way.elements.num_clusters; cluster += step) {
    if (is_clear(way.field, frame, way.elements.clusters[cluster], way.rounding[cluster])) continue;
    add_solid_element<Sample>(way, frame, cluster, share, stiffness);
  }
}

}  // namespace
}}  // namespace palpate::v0
