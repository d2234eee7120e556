// A surface as smooth as its data allow: inverse depth, in which planes are linear, is divided into
// scales, and at every place only those details are kept that exceed the sensor's noise. Shared
// code for CPU and GPU.
//
// A cell of level k is 2^k pixels wide and holds the mean inverse depth m of its surface. A local
// quadratic through the cells of level k + 1 predicts those of level k,
//   d = m - predicted,
// and the smoothed image is, from the widest level down,
//   smoothed = predicted from the smoothed wider cells + keep d,   0 <= keep <= 1.
// On planes, and wherever a quadratic leaves nothing but noise, keep is 0. It is 1 where the
// details of a neighborhood carry more energy than noise does, at this level or, since an edge is
// seen best at the scale at which the noise is least, at another one: energy is handed on to wider
// cells whole (a step is as high at any scale) and to finer ones as a tenth (the curvature of a
// bend falls faster). So a step or a small ball stays, and a table becomes flat. Of single pixels
// the mean of the details around is kept, since what stays has noise, too. After intersection of
// confidence intervals (Lepski, Goldenshluger, Katkovnik) and block thresholding (Cai), with the
// noise of each level learned from the frame itself (scale_noise.h).
#pragma once

#include <cstddef>

#include "src/cloud/surface/adaptive/scale_noise.h"
#include "src/core/internal/lanes.h"

namespace palpate { inline namespace v0 {

/// Neighboring cells of level k differ by less than this share of their inverse depth: beyond lies
/// another surface. The limit grows with the width of the cells, along slanted surfaces.
PALPATE_FORMULA float scale_tolerance(int level) {
  const float share = 0.012f * static_cast<float>(1 << level);
  return share < 0.2f ? share : 0.2f;
}

/// Bend of a surface between neighboring cells, as a share of its inverse depth: beyond, another
/// surface begins, and a cell goes on as flat as its flatter side.
inline constexpr float kMaxBend = 0.015f;
/// Largest energy of one cell, in variances of the noise: an outlier is no shape.
inline constexpr float kMaxEnergy = 24.0f;
/// Mean energy of a neighborhood that noise alone does not exceed, in its variances.
inline constexpr float kNoiseEnergy = 4.0f;
/// Share of a cell's energy that counts in the cells of the next finer level.
inline constexpr float kFinerShare = 0.12f;
/// Energy from which on a detail is kept whole, in variances of the noise.
inline constexpr float kSureEnergy = 1.5f;
/// Levels of which the mean of details around is kept. Its widths in cells and in inverse depth at
/// level 0, and in details, as 1 / (2 sigma^2 ln 2): 1.5 pixels, 0.01 / m, and 6 sd of the noise.
inline constexpr int kCalmLevels = 3;
inline constexpr float kCalmSpace = 0.3206f, kCalmRange = 7213.0f, kCalmNoise = 0.02f;

}}  // namespace palpate::v0

namespace palpate { inline namespace v0 { namespace PALPATE_ISA_NAMESPACE { namespace {

/// Returns the mean of two cells of one surface, 0 of others. 0: no surface.
PALPATE_FORMULA VecF joined_pair(VecF a, VecF b, float tolerance) {
  const VecF zero = splat(0.0f), mean = 0.5f * (a + b);
  return select((a > zero) & (b > zero) & (abs(a - b) <= tolerance * mean), mean, zero);
}

/// Returns the mean at the center of two by two cells: of all, or of a diagonal, which is exact on
/// planes where a cell is missing.
PALPATE_FORMULA VecF joined_cells(VecF a, VecF b, VecF c, VecF d, float tolerance) {
  const VecF zero = splat(0.0f);
  const VecF down = joined_pair(a, d, tolerance), up = joined_pair(b, c, tolerance);
  const Mask has_down = down > zero, has_up = up > zero;
  return select(has_down & has_up, joined_pair(down, up, tolerance), select(has_down, down, up));
}

/// Values of the lower and the upper half of a cell along one axis. 0: a cell is missing.
struct Halves {
  VecF lower, upper;
};
/// Returns the halves of the cell `at` among its neighbors: blends of the two nearest of the
/// quadratics whose means over three cells are theirs. Exact for quadratics.
PALPATE_FORMULA Halves halves_of(VecF before2, VecF before, VecF at, VecF after, VecF after2) {
  const VecF zero = splat(0.0f);
  const VecF a2 = before2 - at, a = before - at, b = after - at, b2 = after2 - at;
  const Mask is_known = (before > zero) & (at > zero) & (after > zero);
  return {select(is_known & (before2 > zero), at + (7.0f * a - 3.0f * b - a2) * 0.03125f, zero),
          select(is_known & (after2 > zero), at + (7.0f * b - 3.0f * a - b2) * 0.03125f, zero)};
}

/// The change of a cell's surface over a quarter of a cell along one axis.
struct QuarterSlope {
  VecF change;
  Mask is_known;  ///< a neighbor shows its surface
};
PALPATE_FORMULA QuarterSlope quarter_slope(VecF before, VecF at, VecF after, float tolerance) {
  const VecF zero = splat(0.0f), limit = tolerance * at;
  const VecF back = at - before, ahead = after - at;
  const Mask has_before = (before > zero) & (abs(back) <= limit);
  const Mask has_after = (after > zero) & (abs(ahead) <= limit);
  const Mask has_both = has_before & has_after;
  const Mask goes_on = has_both & (abs(ahead - back) <= kMaxBend * at);
  const Mask is_flatter_before = abs(back) < abs(ahead);
  const VecF one_sided =
      select(has_both, select(is_flatter_before, back, ahead), select(has_before, back, ahead));
  const Mask is_known = has_before | has_after;
  return {0.25f * select(goes_on, 0.5f * (after - before), one_sided), is_known};
}

/// Returns the quadratic's value if it stays near the cell's own plane, else that of the plane.
PALPATE_FORMULA VecF predicted_cell(VecF quadratic, VecF plane, VecF mean, Mask has_plane) {
  const VecF zero = splat(0.0f);
  const Mask is_near = (quadratic > zero) & (abs(quadratic - plane) <= (0.25f * kMaxBend) * mean);
  return select(has_plane, select(is_near, quadratic, plane), zero);
}

/// Returns the variance of a level's noise in units of inverse depth squared.
PALPATE_FORMULA VecF variance_at(VecF inverse_depth, const ScaleNoise& noise) {
  const VecF sd = noise.growth + noise.base * inverse_depth * inverse_depth;
  const VecF at_least = max(sd, 1e-7f * inverse_depth);  // rounding
  return at_least * at_least;
}

/// Returns the energy of a detail in variances of the noise. The cell has a surface.
PALPATE_FORMULA VecF energy_of(VecF mean, VecF predicted, const ScaleNoise& noise) {
  const VecF d = mean - predicted;
  return min(d * d / variance_at(mean, noise), splat(kMaxEnergy));
}
/// Returns the energy of a neighborhood beyond that of noise, in inverse depth squared. `sum` is
/// weighted by 1 2 1 each way, `weight` the sum of the weights of what is known.
PALPATE_FORMULA VecF excess_of(VecF sum, VecF weight, VecF mean, const ScaleNoise& noise) {
  const VecF zero = splat(0.0f);
  const VecF excess = sum / max(weight, splat(1.0f)) - kNoiseEnergy;
  return select((mean > zero) & (excess > zero), excess * variance_at(mean, noise), zero);
}
/// Returns the mean of the details around a cell that are its own but for noise, of surfaces as
/// far as its own: a bilateral filter (thesis eq. 3.12) that leaves planes, bends and edges as they
/// are.
template <int kReach, int kNarrow>
PALPATE_FORMULA VecF mean_detail(const float* mean, const float* predicted, std::ptrdiff_t stride,
                                 const ScaleNoise& noise) {
  constexpr float space = kNarrow * kCalmSpace;
  const VecF zero = splat(0.0f), center = load(mean), own = center - load(predicted);
  const VecF similar = kCalmNoise / variance_at(center, noise);
  VecF sum = zero, sum_weights = zero;
  for (int dv = -kReach; dv <= kReach; ++dv) {
    for (int du = -kReach; du <= kReach; ++du) {
      const VecF m = load(mean + dv * stride + du), p = load(predicted + dv * stride + du);
      const VecF away = m - center, other = m - p - own;
      const VecF exponent = splat(-space * static_cast<float>(du * du + dv * dv)) -
                            kNarrow * kNarrow * kCalmRange * (away * away) -
                            similar * (other * other);
      const VecF weight = select((m > zero) & (p > zero), exp2_negative(exponent), zero);
      sum += weight * other;
      sum_weights += weight;
    }
  }
  return own + sum / max(sum_weights, splat(1e-30f));
}
/// The same at a level below kCalmLevels: of fewer and nearer cells the wider these are.
PALPATE_FORMULA VecF calm_detail(int level, const float* mean, const float* predicted,
                                 std::ptrdiff_t stride, const ScaleNoise& noise) {
  if (level == 0) return mean_detail<2, 1>(mean, predicted, stride, noise);
  if (level == 1) return mean_detail<1, 2>(mean, predicted, stride, noise);
  return mean_detail<1, 4>(mean, predicted, stride, noise);
}
/// Returns where details of a cell are kept.
PALPATE_FORMULA Mask is_kept(VecF mean, VecF predicted, VecF energy) {
  const VecF zero = splat(0.0f);
  return (mean > zero) & (predicted > zero) & (energy > zero);
}
/// Returns the smoothed value of a cell. `wider` is the prediction from smoothed cells.
PALPATE_FORMULA VecF smoothed_cell(VecF mean, VecF detail, VecF predicted, VecF wider, VecF energy,
                                   const ScaleNoise& noise) {
  const VecF zero = splat(0.0f), one = splat(1.0f);
  const VecF sure = kSureEnergy * variance_at(select(mean > zero, mean, one), noise);
  const VecF value = wider + min(energy / sure, one) * detail;
  const Mask is_known = (mean > zero) & (predicted > zero) & (wider > zero) & (value > zero);
  return select(is_known, value, mean);
}

}}}}  // namespace palpate::v0::PALPATE_ISA_NAMESPACE
