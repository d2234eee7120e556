// The step from the noise of depth to that of a measure, without pairs of elements. An element
// changes with the depth of its surface: eta, the noise where its camera sees it, changes its
// volume by -A eta, its force by -A eta n + V grad eta, and its torque likewise. The noise of a
// scale is a quadratic B-spline over white noise of the nodes of a grid, as the field is one over
// its pixels:
//
//   eta(u) = sum_c xi_c B_c(u),   so that   variance = sum_scales v sum_c (sum_e S_e B_c(u_e))^2.
//
// Elements add what they do to the nodes of one grid, and a wider grid's nodes follow from those of
// the finer one, since a wide B-spline is a sum of four narrow ones each way. So elements that see
// the same pixels are correlated, and so are those within the length of the noise.
#pragma once

#include "palpate/math/geometry.h"
#include "src/contact/noise/noise_model.h"
#include "src/contact/noise/noise_rows.h"
#include "src/field/internal/field_sample.h"

namespace palpate { inline namespace v0 {

/// Nodes of a grid each way, at most, and the numbers of a node: volume, force, torque, and 0.
inline constexpr int kNoiseNodes = 26, kNoiseNumbers = 8;

/// True if a sum is neither infinite nor no number, on a device, too.
template <class Real>
PALPATE_HOSTDEV constexpr bool is_number(Real sum) {
  return sum - sum == 0;
}

/// Extent of the elements of one camera, and sums over them.
struct NoiseReach {
  float min_u = 1e9f, max_u = -1e9f, min_v = 1e9f, max_v = -1e9f;  ///< pixels of level 0
  float weight = 0, level = 0, depth = 0;                          ///< sums

  /// Adds an element by the level that it samples and its depth, weighted by what it changes.
  PALPATE_HOSTDEV void add(const NoiseRows& rows, std::ptrdiff_t element) {
    const float u = rows.at(NoiseRow::u, element), v = rows.at(NoiseRow::v, element);
    min_u = u < min_u ? u : min_u;
    max_u = u > max_u ? u : max_u;
    min_v = v < min_v ? v : min_v;
    max_v = v > max_v ? v : max_v;
    float footprint = rows.at(NoiseRow::footprint, element);
    const float nearness = rows.at(NoiseRow::inverse_depth, element);
    // Disc and volume of a ball of that footprint are comparable.
    const float volume = rows.at(NoiseRow::volume, element);
    const float disc = rows.change(0, element);
    const float each = (volume < 0 ? -volume : volume) * nearness + (disc < 0 ? -disc : disc);
    float of_level = 0;
    while (footprint >= 2) {
      footprint *= 0.5f;
      of_level += 1;
    }
    if (footprint > 1) of_level += smooth_step((footprint - 1) * (1 / (kBlendEnd - 1))).value;
    weight += each;
    level += each * of_level;
    depth += each / nearness;
  }
};

/// Returns the grid of elements of finite sums: as fine as the pixels that they sample, but not too
/// large.
PALPATE_HOSTDEV inline CellWindow noise_window(const NoiseReach& reach) {
  CellWindow window;
  window.level = static_cast<int>(reach.level / reach.weight + 0.5f);
  for (;; ++window.level) {
    const float scale = 1 / static_cast<float>(1 << window.level);
    const auto nearest = [&](float pixel) {
      const float cell = (pixel + 0.5f) * scale;
      const int whole = static_cast<int>(cell);
      return cell < static_cast<float>(whole) ? whole - 1 : whole;
    };
    window.left = nearest(reach.min_u) - 1;
    window.right = nearest(reach.max_u) + 1;
    window.top = nearest(reach.min_v) - 1;
    window.bottom = nearest(reach.max_v) + 1;
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

/// Returns the window of the nodes of the next wider level.
PALPATE_HOSTDEV inline CellWindow wider_nodes(const CellWindow& finer) {
  return {finer.level + 1, (finer.left - 1) >> 1, (finer.top - 1) >> 1, (finer.right + 1) >> 1,
          (finer.bottom + 1) >> 1};
}
/// Calls f(weight, u, v) for the nodes of a window whose B-splines add up to that of node (u, v) of
/// the next wider level.
template <class F>
PALPATE_HOSTDEV inline void for_finer_nodes(const CellWindow& finer, int u, int v, const F& f) {
  constexpr int num = 4;  // each way
  const auto weight = [](int i) { return i == 0 || i == num - 1 ? 0.25f : 0.75f; };
  const int left = 2 * u - 1, top = 2 * v - 1;
  const auto first = [](int begin, int least) { return begin < least ? least - begin : 0; };
  const auto end = [](int begin, int most) { return begin + num > most ? most + 1 - begin : num; };
  const int first_p = first(left, finer.left), end_p = end(left, finer.right);
  const int end_q = end(top, finer.bottom);
  for (int q = first(top, finer.top); q < end_q; ++q) {
    for (int p = first_p; p < end_p; ++p) f(weight(q) * weight(p), left + p, top + q);
  }
}

/// Adds the variance of one scale: `squares` of the numbers of a node, and `products` of each with
/// the next axis.
template <class Real>
PALPATE_HOSTDEV inline void add_variances(const Real* squares, const Real* products, float variance,
                                          MeasureNoise& to) {
  const auto times = [&](Real sum) {
    return static_cast<double>(variance) * static_cast<double>(sum);
  };
  to.volume += times(squares[0]);
  for (int axis = 0; axis < 3; ++axis) {
    const int next = (axis + 1) % 3;
    to.force.m[axis][axis] += times(squares[1 + axis]);
    to.torque.m[axis][axis] += times(squares[4 + axis]);
    to.force.m[axis][next] = to.force.m[next][axis] += times(products[1 + axis]);
    to.torque.m[axis][next] = to.torque.m[next][axis] += times(products[4 + axis]);
  }
}

/// Changes by an element for each meter of depth at its place, and for each meter per pixel.
struct NoiseChange {
  float by_depth[kNoiseNumbers], by_u[kNoiseNumbers], by_v[kNoiseNumbers];
};
/// A camera's focal lengths and principal point, and its axes in W.
struct NoiseCamera {
  float fx = 1, fy = 1, cx = 0, cy = 0;
  float R_WC[3][3] = {{1, 0, 0}, {0, 1, 0}, {0, 0, 1}};
};
/// Writes what a change of the gradient by `j` does to a force of one element: that part of it
/// which is along n is none, as a gradient has a length of 1.
PALPATE_HOSTDEV inline void set_turned(float volume, const float (&j)[3], const float (&n)[3],
                                       const float (&l)[3], float (&to)[kNoiseNumbers]) {
  const float along = j[0] * n[0] + j[1] * n[1] + j[2] * n[2];
  to[0] = to[7] = 0;
  for (int axis = 0; axis < 3; ++axis) to[1 + axis] = volume * (j[axis] - along * n[axis]);
  to[4] = l[1] * to[3] - l[2] * to[2];
  to[5] = l[2] * to[1] - l[0] * to[3];
  to[6] = l[0] * to[2] - l[1] * to[1];
}
PALPATE_HOSTDEV inline NoiseChange noise_change(const NoiseRows& rows, std::ptrdiff_t element,
                                                const NoiseCamera& camera) {
  const auto at = [&](NoiseRow row) { return rows.at(row, element); };
  const float l[3] = {at(NoiseRow::lx), at(NoiseRow::ly), at(NoiseRow::lz)};
  const float n[3] = {at(NoiseRow::nx), at(NoiseRow::ny), at(NoiseRow::nz)};
  const float moved = at(NoiseRow::volume) * at(NoiseRow::inverse_depth);
  const float x = at(NoiseRow::u) - camera.cx, y = at(NoiseRow::v) - camera.cy;
  const auto& R = camera.R_WC;
  NoiseChange change;
  for (int k = 0; k < kNumChanges; ++k) change.by_depth[k] = rows.change(k, element);
  change.by_depth[kNumChanges] = 0;
  // The pixel of a place moves by (fx, 0, -x) / z and (0, fy, -y) / z along the camera's axes.
  const float by_x[3] = {R[0][0] * camera.fx - R[0][2] * x, R[1][0] * camera.fx - R[1][2] * x,
                         R[2][0] * camera.fx - R[2][2] * x};
  const float by_y[3] = {R[0][1] * camera.fy - R[0][2] * y, R[1][1] * camera.fy - R[1][2] * y,
                         R[2][1] * camera.fy - R[2][2] * y};
  set_turned(moved, by_x, n, l, change.by_u);
  set_turned(moved, by_y, n, l, change.by_v);
  return change;
}

}}  // namespace palpate::v0
