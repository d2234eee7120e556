// The moments of a pixel's window and its neighbors' covariance (thesis section 3.4,
// eqs. 3.9-3.11). Shared code for vectors and for single numbers (lanes.h).
//
// Most windows of a frame are whole: every pixel valid and within the depth gate. Then all weights
// are 1 and the moments are separable: sums over rows first, shared by all windows above each
// other, then over columns. The remaining pixels (borders, holes, edges) and all pixels when an
// option requires other weights take the direct way, tap by tap.
#pragma once

#include <cstddef>

#include "src/cloud/surface/plane_fit.h"
#include "src/cloud/surface/surface_kernels.h"

namespace palpate { inline namespace v0 { namespace PALPATE_ISA_NAMESPACE { namespace {

/// Beyond this relative distance from the reference depth of its column the separable sums would
/// lose digits of the depth noise; such pixels go the direct way.
inline constexpr float kMaxReferenceOffset = 0.04f;

/// Neighbors nearer to the center than this (times depth) have no direction (eq. 3.11).
inline constexpr float kMinDifference = 1e-5f;

// --- Whole windows -----------------------------------------------------------------------------

/// One row of a window, about the reference depth of its column.
struct WindowRow {
  RowMoments t, tt;
  VecF min, max;  ///< of z
};

PALPATE_FORMULA WindowRow sum_row(const float* center, VecF reference, int radius) {
  const VecF z = load(center);
  const VecF t = z - reference;
  const VecF zero = splat(0.0f);
  WindowRow row{{t, zero, zero}, {t * t, zero, zero}, z, z};
  for (int k = 1; k <= radius; ++k) {
    const VecF z_left = load(center - k), z_right = load(center + k);
    row.min = min(row.min, min(z_left, z_right));
    row.max = max(row.max, max(z_left, z_right));
    const VecF left = z_left - reference, right = z_right - reference;
    const VecF left_squared = left * left, right_squared = right * right;
    const float du = static_cast<float>(k);
    const VecF both = left + right, both_squared = left_squared + right_squared;
    row.t.s += both;
    row.t.u += du * (right - left);
    row.t.uu += du * du * both;
    row.tt.s += both_squared;
    row.tt.u += du * (right_squared - left_squared);
    row.tt.uu += du * du * both_squared;
  }
  return row;
}

PALPATE_HOSTDEV inline void add_rows(Moments& sum, const RowMoments& above, const RowMoments& below,
                                     float dv) {
  const VecF both = above.s + below.s;
  sum.s += both;
  sum.u += above.u + below.u;
  sum.v += dv * (below.s - above.s);
  sum.uu += above.uu + below.uu;
  sum.uv += dv * (below.u - above.u);
  sum.vv += dv * dv * both;
}

struct WholeWindow {
  WindowSums sums;
  VecF min, max;
};

/// `row(k)` is the WindowRow k rows below the center.
template <class Rows>
PALPATE_FORMULA WholeWindow sum_columns(const Rows& row, VecF reference, int radius) {
  const VecF zero = splat(0.0f);
  const int size = 2 * radius + 1;
  const VecF num = splat(static_cast<float>(size * size));
  // sum of du^2 over the window = size^2 (size^2 - 1) / 12
  const VecF spread = num * (num - 1.0f) * (1.0f / 12.0f);
  const WindowRow& center = row(0);
  WholeWindow window{{{num, zero, zero, spread, zero, spread},
                      {center.t.s, center.t.u, zero, center.t.uu, zero, zero},
                      {center.tt.s, center.tt.u, zero, center.tt.uu, zero, zero},
                      reference},
                     center.min,
                     center.max};
  for (int k = 1; k <= radius; ++k) {
    const WindowRow& above = row(-k);
    const WindowRow& below = row(k);
    const float dv = static_cast<float>(k);
    add_rows(window.sums.t, above.t, below.t, dv);
    add_rows(window.sums.tt, above.tt, below.tt, dv);
    window.min = min(window.min, min(above.min, below.min));
    window.max = max(window.max, max(above.max, below.max));
  }
  return window;
}

/// True if all pixels of the window around depth z are neighbors and the reference is near enough.
PALPATE_FORMULA Mask is_whole(const WholeWindow& window, VecF z, float max_depth_change) {
  const VecF gate = max_depth_change * z;
  return (window.max - z <= gate) & (z - window.min <= gate) &
         (abs(z - window.sums.reference) <= kMaxReferenceOffset * z);
}

/// The reference depth of a column of a strip is its first valid one from the middle row on: the
/// i-th to try is this row.
PALPATE_HOSTDEV inline int reference_row(int i, int num_rows) {
  return (i + num_rows / 2) % num_rows;
}

// --- Any window --------------------------------------------------------------------------------

/// 1 for a neighbor, 0 for others.
struct GateWeight {
  VecF gate;

  PALPATE_HOSTDEV VecF operator()(int, int, VecF, VecF depth_difference) const {
    return select(abs(depth_difference) <= gate, splat(1.0f), splat(0.0f));
  }
};

/// exp(-|p - q|^2 / (2 sigma^2)), eq. 3.10, for neighbors.
struct DistanceWeight {
  GateWeight neighbor;
  PixelFrame frame;
  VecF scale;  // 1 / (2 sigma^2 ln 2)

  PALPATE_HOSTDEV VecF operator()(int du, int dv, VecF z, VecF depth_difference) const {
    const Vector e{static_cast<float>(du) * z, static_cast<float>(dv) * z, depth_difference};
    const Vector d = to_camera(e, frame);
    const VecF weight = exp2_negative(-scale * (d.x * d.x + d.y * d.y + d.z * d.z));
    return weight * neighbor(du, dv, z, depth_difference);
  }
};

/// Adds the taps at -du and du (`left` and `right`) of one row.
PALPATE_HOSTDEV inline void add_taps(RowMoments& sum, VecF left, VecF right, float du) {
  const VecF both = left + right;
  sum.s += both;
  sum.u += du * (right - left);
  sum.uu += du * du * both;
}

PALPATE_HOSTDEV inline void add_row(Moments& sum, const RowMoments& row, float dv) {
  sum.s += row.s;
  sum.u += row.u;
  sum.v += dv * row.s;
  sum.uu += row.uu;
  sum.uv += dv * row.u;
  sum.vv += dv * dv * row.s;
}

/// Computes the moments about p itself.
template <class Weight>
PALPATE_FORMULA WindowSums sum_window(const float* center, std::ptrdiff_t stride, int radius,
                                      const Weight& weight) {
  const VecF z_p = load(center);
  const VecF zero = splat(0.0f);
  const Moments none{zero, zero, zero, zero, zero, zero};
  WindowSums sums{none, none, none, z_p};
  for (int dv = -radius; dv <= radius; ++dv) {
    const float* row = center + dv * stride;
    const VecF z = load(row);
    const VecF w = weight(0, dv, z, z - z_p), t = w * (z - z_p);
    RowMoments row_w{w, zero, zero}, row_t{t, zero, zero}, row_tt{t * (z - z_p), zero, zero};
    for (int k = 1; k <= radius; ++k) {
      const VecF z_left = load(row - k), z_right = load(row + k);
      const VecF left = z_left - z_p, right = z_right - z_p;
      const VecF w_left = weight(-k, dv, z_left, left), w_right = weight(k, dv, z_right, right);
      const VecF t_left = w_left * left, t_right = w_right * right;
      const float du = static_cast<float>(k);
      add_taps(row_w, w_left, w_right, du);
      add_taps(row_t, t_left, t_right, du);
      add_taps(row_tt, t_left * left, t_right * right, du);
    }
    add_row(sums.w, row_w, static_cast<float>(dv));
    add_row(sums.t, row_t, static_cast<float>(dv));
    add_row(sums.tt, row_tt, static_cast<float>(dv));
  }
  return sums;
}

/// Covariance of directions instead of differences (eq. 3.11), up to a factor.
template <class Weight>
PALPATE_HOSTDEV inline SymmetricMatrix direction_covariance(const float* center,
                                                            std::ptrdiff_t stride, int radius,
                                                            const Weight& weight,
                                                            const Vector& origin,
                                                            const PixelFrame& frame) {
  const VecF z_p = load(center);
  const VecF zero = splat(0.0f);
  const VecF min_difference = kMinDifference * z_p;
  SymmetricMatrix c{zero, zero, zero, zero, zero, zero};
  for (int dv = -radius; dv <= radius; ++dv) {
    for (int du = -radius; du <= radius; ++du) {
      const VecF z = load(center + dv * stride + du);
      const Vector e{static_cast<float>(du) * z - origin.x, static_cast<float>(dv) * z - origin.y,
                     z - z_p - origin.z};
      const Vector d = to_camera(e, frame);
      const VecF squared = d.x * d.x + d.y * d.y + d.z * d.z;
      const VecF w = select(squared > min_difference * min_difference,
                            weight(du, dv, z, z - z_p) / squared, zero);
      c.xx += w * e.x * e.x;
      c.xy += w * e.x * e.y;
      c.xz += w * e.x * e.z;
      c.yy += w * e.y * e.y;
      c.yz += w * e.y * e.z;
      c.zz += w * e.z * e.z;
    }
  }
  return c;
}

/// True if there are enough neighbors, not all on one line: the spread of (du, dv) has full rank.
PALPATE_HOSTDEV inline Mask spans_plane(const Moments& count, float min_neighbors) {
  const VecF uu = count.s * count.uu - count.u * count.u;
  const VecF uv = count.s * count.uv - count.u * count.v;
  const VecF vv = count.s * count.vv - count.v * count.v;
  return (count.s >= min_neighbors) & (uu * vv - uv * uv > kMinSpread * uu * vv);
}

struct Neighbors {
  SymmetricMatrix e;  // their covariance
  Mask valid;         // enough for a plane
};

template <class Weight>
PALPATE_HOSTDEV inline SymmetricMatrix weighted_covariance(const NormalPass& pass,
                                                           const float* center,
                                                           const WindowSums& sums,
                                                           const Weight& weight,
                                                           const PixelFrame& frame) {
  const VecF zero = splat(0.0f);
  const Vector origin = pass.anchoring ? Vector{zero, zero, zero} : mean_of(sums);
  return pass.normalization
             ? direction_covariance(center, pass.in.stride, pass.radius, weight, origin, frame)
             : covariance(sums, origin);
}

PALPATE_FORMULA Neighbors gather_directly(const NormalPass& pass, const float* center,
                                          const PixelFrame& frame, int radius) {
  const VecF z = load(center);
  const GateWeight gate{pass.max_depth_change * z};
  const WindowSums sums = sum_window(center, pass.in.stride, radius, gate);
  SymmetricMatrix e;
  if (pass.weighting) {
    const VecF squared = z * z;
    const DistanceWeight weight{gate, frame, pass.weight / (squared * squared)};
    e = weighted_covariance(pass, center, sum_window(center, pass.in.stride, pass.radius, weight),
                            weight, frame);
  } else {
    e = weighted_covariance(pass, center, sums, gate, frame);
  }
  return {e, spans_plane(sums.w, pass.min_neighbors)};
}

}}}}  // namespace palpate::v0::PALPATE_ISA_NAMESPACE
