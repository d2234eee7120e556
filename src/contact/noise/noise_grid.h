// The step from the noise of depth to that of a measure, without pairs of elements. An element
// changes with the depth of its surface: eta, the noise where its camera sees it, changes its
// volume by -A eta, its force by -A eta n + V grad eta, and its torque likewise. The noise of a
// scale is a quadratic B-spline over white noise of the nodes of a grid, as the field is one over
// its pixels:
//
//   eta(u) = sum_c xi_c B_c(u),   so that   variance = sum_scales v sum_c (sum_p S_p B_c(u_p))^2.
//
// Patches, the elements of a cluster that one camera decides, add what they do to the nodes of one
// grid, which are as far apart as a patch is wide: so a spline spreads a patch over what its
// elements cover. A wider grid's nodes follow from those of the finer one, since a wide B-spline is
// a sum of four narrow ones each way. So patches that see the same pixels are correlated, and so
// are those within the length of the noise.
#pragma once

#include "src/contact/noise/noise_model.h"
#include "src/contact/noise/noise_patch.h"
#include "src/field/internal/field_sample.h"

namespace palpate { inline namespace v0 {

/// Nodes of a grid each way, at most, and the numbers of a node: volume, force, torque, and 0.
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
    min_u = patch.u < min_u ? patch.u : min_u;
    max_u = patch.u > max_u ? patch.u : max_u;
    min_v = patch.v < min_v ? patch.v : min_v;
    max_v = patch.v > max_v ? patch.v : max_v;
    weight += patch.weight;
    square += patch.weight * patch.square;
    depth += patch.weight * patch.depth;
  }
};

/// Returns the grid of the patches, which is not too large. A B-spline over nodes h apart has the
/// second moment h^2 / 4 each way.
PALPATE_HOSTDEV inline CellWindow noise_window(const NoiseReach& reach, const NoiseCamera& camera) {
  CellWindow window;
  const float squared = 2 * reach.square / reach.weight;  // distance of the nodes
  while (static_cast<float>(2 << 2 * window.level) < squared && window.level < 10) ++window.level;
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
/// Returns them for a place in pixels of level 0.
PALPATE_HOSTDEV inline NodeWeights node_weights(float pixel, int begin, float scale) {
  const float at = (pixel + 0.5f) * scale - static_cast<float>(begin);  // in cells
  const int node = static_cast<int>(at);                                // not negative
  const float t = at - static_cast<float>(node) - 0.5f, a = 0.5f - t, b = 0.5f + t;
  return {node - 1,
          {0.5f * a * a, 0.75f - t * t, 0.5f * b * b},
          {-a * scale, -2 * t * scale, b * scale}};
}

/// Changes by a patch for each meter of depth at its place, and for each meter per pixel.
struct NoiseChange {
  float by_depth[kNoiseNumbers], by_u[kNoiseNumbers], by_v[kNoiseNumbers];
};
/// Completes a change of the force by the torque that it has at lever l. It changes no volume.
PALPATE_HOSTDEV inline void set_change(float volume, const float (&force)[3], const float (&l)[3],
                                       float (&to)[kNoiseNumbers]) {
  to[0] = volume;
  for (int axis = 0; axis < 3; ++axis) to[1 + axis] = force[axis];
  to[4] = l[1] * force[2] - l[2] * force[1];
  to[5] = l[2] * force[0] - l[0] * force[2];
  to[6] = l[0] * force[1] - l[1] * force[0];
  to[7] = 0;
}
PALPATE_HOSTDEV inline NoiseChange noise_change(const NoisePatch& patch,
                                                const NoiseCamera& camera) {
  const auto& R = camera.R_WC;
  const float z = patch.depth;
  const float p[3] = {patch.u * z / camera.fx - camera.p_WC[0],
                      patch.v * z / camera.fy - camera.p_WC[1], z - camera.p_WC[2]};
  float l[3];
  for (int axis = 0; axis < 3; ++axis) {
    l[axis] = R[axis][0] * p[0] + R[axis][1] * p[1] + R[axis][2] * p[2];
  }
  NoiseChange change;
  set_change(patch.disc, patch.force, l, change.by_depth);
  // The pixel of a place moves by (fx, 0, -x) / z and (0, fy, -y) / z along the camera's axes. The
  // gradient turns by that, less what is along n, as it has a length of 1.
  const float share = patch.moved != 0 ? 1 / patch.moved : 0.0f;
  const auto turn = [&](int column, float focal, float from_center, float(&to)[kNoiseNumbers]) {
    float j[3], along = 0;
    for (int axis = 0; axis < 3; ++axis) {
      j[axis] = R[axis][column] * focal - R[axis][2] * from_center;
      along += j[axis] * patch.moved_n[axis] * share;
    }
    for (int axis = 0; axis < 3; ++axis) {
      j[axis] = patch.moved * j[axis] - along * patch.moved_n[axis];
    }
    set_change(0, j, l, to);
  };
  turn(0, camera.fx, patch.u, change.by_u);
  turn(1, camera.fy, patch.v, change.by_v);
  return change;
}

}}  // namespace palpate::v0
