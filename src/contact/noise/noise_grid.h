// The step from the noise of depth to that of a measure, without pairs of elements. An element
// changes with the depth of its surface: eta, the noise where its camera sees it, changes its
// volume by -A eta, its force by -A eta n + V grad eta, and its torque likewise. The noise of a
// scale is a quadratic B-spline over white noise of the nodes of a grid, as the field is one over
// its pixels:
//
//   eta(u) = sum_c xi_c B_c(u),   so that   variance = sum_scales v sum_c (sum_p S_p B_c(u_p))^2.
//
// Patches, the elements of a cluster that one camera decides, are added up in cells about as large
// as they are, and cells add what they do to the nodes of one grid. Its nodes are as far apart as
// cells are wide: so a spline spreads a cell over what its elements cover. A wider grid's nodes
// follow from those of the finer one, since a wide B-spline is a sum of four narrow ones each way.
// So what sees the same pixels is correlated, and so is what lies within the length of the noise.
#pragma once

#include "src/contact/noise/noise_model.h"
#include "src/contact/noise/noise_patch.h"
#include "src/field/internal/field_sample.h"

namespace palpate { inline namespace v0 {

/// Nodes of a grid each way, at most, and the numbers of a node: force, volume, torque, and 0.
inline constexpr int kNoiseNodes = 18, kNoiseNumbers = 8;

/// A camera's focal lengths and principal point, where C lies in it, and its axes in W.
struct NoiseCamera {
  float fx = 1, fy = 1, cx = 0, cy = 0;
  float p_WC[3] = {};
  float R_WC[3][3] = {{1, 0, 0}, {0, 1, 0}, {0, 0, 1}};
};

/// Extent of the patches of one camera, and means over them.
struct NoiseReach {
  float min_u = 1e9f, max_u = -1e9f, min_v = 1e9f, max_v = -1e9f;  ///< from the principal point
  float weight = 0, square = 0, depth = 0;                         ///< sums

  PALPATE_HOSTDEV void add(const NoisePatch& patch) {
    min_u = patch.at_u < min_u ? patch.at_u : min_u;
    max_u = patch.at_u > max_u ? patch.at_u : max_u;
    min_v = patch.at_v < min_v ? patch.at_v : min_v;
    max_v = patch.at_v > max_v ? patch.at_v : max_v;
    weight += patch.weight;
    square += patch.square - patch.u * patch.at_u - patch.v * patch.at_v;
    depth += patch.depth;
  }
};

/// Returns the grid of the patches, which is not too large. A square of the width w has the second
/// moments w^2 / 12, together `square`: nodes are no closer than about half of w.
PALPATE_HOSTDEV inline CellWindow noise_window(const NoiseReach& reach, const NoiseCamera& camera) {
  constexpr float of_square = 1.6f, max_level = 10;
  CellWindow window;
  const float squared = of_square * reach.square / reach.weight;
  while (static_cast<float>(1 << 2 * window.level) < squared && window.level < max_level) {
    ++window.level;
  }
  for (;; ++window.level) {
    const float scale = 1 / static_cast<float>(1 << window.level);
    const auto nearest = [&](float pixel) {
      const float cell = (pixel + 0.5f) * scale;
      const int whole = static_cast<int>(cell);
      return cell < static_cast<float>(whole) ? whole - 1 : whole;
    };
    window.left = nearest(reach.min_u + camera.cx) - 1;
    window.right = nearest(reach.max_u + camera.cx) + 1;
    window.top = nearest(reach.min_v + camera.cy) - 1;
    window.bottom = nearest(reach.max_v + camera.cy) + 1;
    if (window.right - window.left < kNoiseNodes && window.bottom - window.top < kNoiseNodes) break;
  }
  return window;
}

/// Values and slopes of the B-splines of three nodes, and the first one.
struct NodeWeights {
  int first;
  float value[3], slope[3];
};
/// Returns them for a place, in pixels of level 0, in the cells from `first` to `last`, of which a
/// mean may be beyond by rounding.
PALPATE_HOSTDEV inline NodeWeights node_weights(float pixel, int first, int last, float scale) {
  const float at = (pixel + 0.5f) * scale - static_cast<float>(first);  // in cells
  const int nearest = static_cast<int>(at), end = last - first - 1;
  const int node = nearest < 1 ? 1 : nearest > end ? end : nearest;
  const float t = at - static_cast<float>(node) - 0.5f, a = 0.5f - t, b = 0.5f + t;
  return {node - 1,
          {0.5f * a * a, 0.75f - t * t, 0.5f * b * b},
          {-a * scale, -2 * t * scale, b * scale}};
}

}}  // namespace palpate::v0
