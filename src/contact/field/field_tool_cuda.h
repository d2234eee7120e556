// The tool of the field method, on a GPU.
#pragma once

#include "src/contact/field/field_bound.h"
#include "src/contact/index/tool_parts.h"
#include "src/gpu/internal/runtime.h"

namespace palpate { inline namespace v0 {

/// An element: its center from the center of mass, in T.
struct alignas(16) ElementBall {
  float x = 0, y = 0, z = 0, radius = 0;
};

/// FieldElements on a GPU. A warp takes a cluster of them.
struct ElementsView {
  const ElementBall* balls = nullptr;
  const float* factors = nullptr;  ///< -factor if the element is not counted as a sphere; -0 too
  const Cluster* clusters = nullptr;
  const float* largest_radius = nullptr;  ///< per cluster
  int num_clusters = 0;
  const float* ball_factor = nullptr;   ///< per cluster
  int first_ball = 0;                   ///< clusters from this one on are the parts of balls
  const float* places = nullptr;        ///< BallPlaces
  const ElementBall* wholes = nullptr;  ///< WholeClusters, likewise
  const float *whole_factors = nullptr, *whole_depths = nullptr, *whole_counts = nullptr;
  const float* whole_polars = nullptr;
};

/// The elements and spheres of a tool for one of SphereVolumes, on a GPU.
struct FieldTool {
  ElementsView elements;
  const Sphere* spheres = nullptr;  ///< field_ball of each sphere of the tool
  double reach = 0;                 ///< as FieldElements
  Cluster whole;                    ///< around all elements
  float largest_radius = 0;         ///< the largest one of a cluster
};

/// Copies arrays to the GPU; `memory` owns them and keeps failures.
ElementsView elements_view(const FieldElements& elements, gpu::Memory& memory);
FieldTool make_field_tool(const ToolIndex& index, SphereVolumes volumes, gpu::Memory& memory);

}}  // namespace palpate::v0
