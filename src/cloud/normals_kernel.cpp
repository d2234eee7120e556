// Unprojection and normals by a plane fit (thesis section 3.4, eqs. 3.7-3.11), compiled once per
// instruction set.
//
// Most windows of a frame are whole: every pixel valid and within the depth gate. Then all weights
// are 1 and the moments are separable: sums over rows first, shared by all windows above each
// other, then over columns. The remaining pixels (borders, holes, edges) and all pixels when an
// option asks for other weights take the direct way, tap by tap, on kLanes pixels at once.
#include <algorithm>
#include <limits>

#include "src/cloud/plane_fit.h"
#include "src/cloud/surface_kernels.h"
#include "src/core/simd.h"

namespace palpate::PALPATE_ISA_NAMESPACE {
namespace {

// Beyond this relative distance from the reference depth of its column the separable sums would
// lose digits of the depth noise; such pixels go the direct way.
constexpr float kMaxReferenceOffset = 0.04f;

// Neighbours nearer to the centre than this (times depth) have no direction (eq. 3.11).
constexpr float kMinDifference = 1e-5f;

// --- Whole windows -----------------------------------------------------------------------------

struct RowSums {
  RowMoments t, tt;
  VecF min, max;  // of z
};

[[gnu::always_inline]] inline RowSums sum_row(const float* centre, VecF reference, int radius) {
  const VecF z = load(centre);
  const VecF t = z - reference;
  const VecF zero = splat(0.0f);
  RowSums row{{t, zero, zero}, {t * t, zero, zero}, z, z};
  for (int k = 1; k <= radius; ++k) {
    const VecF z_left = load(centre - k), z_right = load(centre + k);
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

inline void add_rows(Moments& sum, const RowMoments& above, const RowMoments& below, float dv) {
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

[[gnu::always_inline]] inline WholeWindow sum_columns(const RowSums* centre, VecF reference,
                                                      int radius) {
  const VecF zero = splat(0.0f);
  const int size = 2 * radius + 1;
  const VecF num = splat(static_cast<float>(size * size));
  // sum of du^2 over the window = size^2 (size^2 - 1) / 12
  const VecF spread = num * (num - 1.0f) * (1.0f / 12.0f);
  WholeWindow window{{{num, zero, zero, spread, zero, spread},
                      {centre->t.s, centre->t.u, zero, centre->t.uu, zero, zero},
                      {centre->tt.s, centre->tt.u, zero, centre->tt.uu, zero, zero},
                      reference},
                     centre->min,
                     centre->max};
  for (int k = 1; k <= radius; ++k) {
    const RowSums& above = centre[-k];
    const RowSums& below = centre[k];
    const float dv = static_cast<float>(k);
    add_rows(window.sums.t, above.t, below.t, dv);
    add_rows(window.sums.tt, above.tt, below.tt, dv);
    window.min = min(window.min, min(above.min, below.min));
    window.max = max(window.max, max(above.max, below.max));
  }
  return window;
}

// --- Any window --------------------------------------------------------------------------------

// 1 for a neighbour, 0 for others.
struct GateWeight {
  VecF gate;

  VecF operator()(int, int, VecF, VecF depth_difference) const {
    return select(abs(depth_difference) <= gate, splat(1.0f), splat(0.0f));
  }
};

// exp(-|p - q|^2 / (2 sigma^2)), eq. 3.10, for neighbours.
struct DistanceWeight {
  GateWeight neighbour;
  PixelFrame frame;
  VecF scale;  // 1 / (2 sigma^2 ln 2)

  VecF operator()(int du, int dv, VecF z, VecF depth_difference) const {
    const Vector e{static_cast<float>(du) * z, static_cast<float>(dv) * z, depth_difference};
    const Vector d = to_camera(e, frame);
    const VecF weight = exp2_negative(-scale * (d.x * d.x + d.y * d.y + d.z * d.z));
    return weight * neighbour(du, dv, z, depth_difference);
  }
};

// Adds the taps at -du and du (`left` and `right`) of one row.
inline void add_taps(RowMoments& sum, VecF left, VecF right, float du) {
  const VecF both = left + right;
  sum.s += both;
  sum.u += du * (right - left);
  sum.uu += du * du * both;
}

inline void add_row(Moments& sum, const RowMoments& row, float dv) {
  sum.s += row.s;
  sum.u += row.u;
  sum.v += dv * row.s;
  sum.uu += row.uu;
  sum.uv += dv * row.u;
  sum.vv += dv * dv * row.s;
}

// Moments about p itself.
template <class Weight>
[[gnu::always_inline]] inline WindowSums sum_window(const float* centre, std::ptrdiff_t stride,
                                                    int radius, const Weight& weight) {
  const VecF z_p = load(centre);
  const VecF zero = splat(0.0f);
  const Moments none{zero, zero, zero, zero, zero, zero};
  WindowSums sums{none, none, none, z_p};
  for (int dv = -radius; dv <= radius; ++dv) {
    const float* row = centre + dv * stride;
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

// The same of directions instead of differences (eq. 3.11), up to a factor.
template <class Weight>
inline SymmetricMatrix direction_covariance(const float* centre, std::ptrdiff_t stride, int radius,
                                            const Weight& weight, const Vector& origin,
                                            const PixelFrame& frame) {
  const VecF z_p = load(centre);
  const VecF zero = splat(0.0f);
  const VecF min_difference = kMinDifference * z_p;
  SymmetricMatrix c{zero, zero, zero, zero, zero, zero};
  for (int dv = -radius; dv <= radius; ++dv) {
    for (int du = -radius; du <= radius; ++du) {
      const VecF z = load(centre + dv * stride + du);
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

// Enough neighbours, not all on one line of the image: the spread of (du, dv) has full rank.
inline VecI spans_plane(const Moments& count, float min_neighbours) {
  const VecF uu = count.s * count.uu - count.u * count.u;
  const VecF uv = count.s * count.uv - count.u * count.v;
  const VecF vv = count.s * count.vv - count.v * count.v;
  return (count.s >= min_neighbours) & (uu * vv - uv * uv > kMinSpread * uu * vv);
}

struct Neighbours {
  SymmetricMatrix e;  // their covariance
  VecI valid;         // enough for a plane
};

template <class Weight>
inline SymmetricMatrix weighted_covariance(const NormalPass& pass, const float* centre,
                                           const WindowSums& sums, const Weight& weight,
                                           const PixelFrame& frame) {
  const VecF zero = splat(0.0f);
  const Vector origin = pass.anchoring ? Vector{zero, zero, zero} : mean_of(sums);
  return pass.normalization
             ? direction_covariance(centre, pass.in.stride, pass.radius, weight, origin, frame)
             : covariance(sums, origin);
}

[[gnu::always_inline]] inline Neighbours gather_directly(const NormalPass& pass,
                                                         const float* centre,
                                                         const PixelFrame& frame, int radius) {
  const VecF z = load(centre);
  const GateWeight gate{pass.max_depth_change * z};
  const WindowSums sums = sum_window(centre, pass.in.stride, radius, gate);
  SymmetricMatrix e;
  if (pass.weighting) {
    const VecF squared = z * z;
    const DistanceWeight weight{gate, frame, pass.weight / (squared * squared)};
    e = weighted_covariance(pass, centre, sum_window(centre, pass.in.stride, pass.radius, weight),
                            weight, frame);
  } else {
    e = weighted_covariance(pass, centre, sums, gate, frame);
  }
  return {e, spans_plane(sums.w, pass.min_neighbours)};
}

// --- Strips ------------------------------------------------------------------------------------

// The reference depth of each column of a strip: its first valid one from the middle row on.
inline VecF column_reference(const PaddedDepth& in, int u, int row_begin, int row_end) {
  const int num_rows = row_end - row_begin;
  VecF reference = splat(kNoDepth);
  for (int i = 0; i < num_rows; ++i) {
    const VecF z = load(in.row(row_begin + (i + num_rows / 2) % num_rows) + u);
    reference = select(reference < kAnyDepth, reference, z);
  }
  return reference;
}

inline PixelFrame frame_at(const NormalPass& pass, int u, int v) {
  return {load(pass.ray_x + u), splat(pass.ray_y[v]), pass.pixel_x, pass.pixel_y};
}

// Writes kLanes pixels of the cloud and returns how many are points. Normals face the camera (3.8).
[[gnu::always_inline]] inline int store_points(const NormalPass& pass, int u, int v,
                                               const Neighbours& neighbours, bool along_ray) {
  const VecF nan = splat(std::numeric_limits<float>::quiet_NaN());
  const VecF z = load(pass.in.row(v) + u);
  const PixelFrame frame = frame_at(pass, u, v);
  const Vector n = along_ray ? normal_along_ray(neighbours.e, frame)
                             : smallest_eigenvector(to_camera(neighbours.e, frame));
  const VecF squared = n.x * n.x + n.y * n.y + n.z * n.z;
  const VecF from_camera = n.x * frame.ray_x + n.y * frame.ray_y + n.z;
  const VecF inverse = 1.0f / sqrt(squared);
  const VecF scale = select(from_camera > 0.0f, -inverse, inverse);
  const VecI valid = neighbours.valid & (squared > 0.0f);
  const VecF values[6] = {frame.ray_x * z, frame.ray_y * z, z,
                          n.x * scale,     n.y * scale,     n.z * scale};
  const std::ptrdiff_t at = static_cast<std::ptrdiff_t>(v) * pass.in.width + u;
  for (int channel = 0; channel < 6; ++channel) {
    store_first(pass.cloud[channel] + at, select(valid, values[channel], nan), pass.in.width - u);
  }
  return __builtin_popcount(mask_bits(valid));
}

// kLanes columns of a strip. Each step runs over all rows before the next starts: the eigenvectors
// are long chains of dependent operations, and only neighbours of their kind can fill the gaps.
[[gnu::always_inline]] inline int do_columns(const NormalPass& pass, int u, int row_begin,
                                             int row_end, int radius, bool along_ray) {
  const bool separable = !pass.anchoring && !pass.weighting && !pass.normalization;
  const VecF reference = column_reference(pass.in, u, row_begin, row_end);
  RowSums rows[kStripRows + 2 * kMaxWindowRadius];
  if (separable && mask_bits(reference < kAnyDepth) != 0) {
    for (int v = row_begin - radius; v < row_end + radius; ++v) {
      rows[v - row_begin + radius] = sum_row(pass.in.row(v) + u, reference, radius);
    }
  }

  const VecI none = VecI{};
  Neighbours neighbours[kStripRows];
  for (int v = row_begin; v < row_end; ++v) {
    Neighbours& here = neighbours[v - row_begin];
    here.valid = none;
    const float* centre = pass.in.row(v) + u;
    const VecF z = load(centre);
    const VecI valid = z < kAnyDepth;
    if (mask_bits(valid) == 0) continue;
    VecI whole = none;
    if (separable) {
      const WholeWindow window = sum_columns(rows + (v - row_begin + radius), reference, radius);
      const VecF gate = pass.max_depth_change * z;
      whole = valid & (window.max - z <= gate) & (z - window.min <= gate) &
              (abs(z - reference) <= kMaxReferenceOffset * z);
      here = {covariance(window.sums, mean_of(window.sums)), whole};
    }
    const VecI rest = valid & ~whole;
    if (mask_bits(rest) != 0) {
      const Neighbours direct = gather_directly(pass, centre, frame_at(pass, u, v), radius);
      here = {blend(whole, here.e, direct.e), whole | (rest & direct.valid)};
    }
  }

  int num_points = 0;
  for (int v = row_begin; v < row_end; ++v) {
    num_points += store_points(pass, u, v, neighbours[v - row_begin], along_ray);
  }
  return num_points;
}

}  // namespace

int estimate_normals(const NormalPass& shared, int row_begin, int row_end) {
  const NormalPass pass = shared;  // a local copy: no store can alias it
  int num_points = 0;
  for (int u = 0; u < pass.in.width; u += kLanes) {
    if (pass.radius != 3) {
      num_points += do_columns(pass, u, row_begin, row_end, pass.radius, pass.along_ray);
    } else if (pass.along_ray) {  // unrolled
      num_points += do_columns(pass, u, row_begin, row_end, 3, true);
    } else {
      num_points += do_columns(pass, u, row_begin, row_end, 3, false);
    }
  }
  return num_points;
}

}  // namespace palpate::PALPATE_ISA_NAMESPACE
