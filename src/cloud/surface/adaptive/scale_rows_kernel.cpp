// The loops over the rows of the scales, compiled once per instruction set. Vectors reach beyond
// the ends of rows, into margins that hold and are given cells without surface.
#include <algorithm>
#include <limits>

#include "src/cloud/frames/raw_depth.h"
#include "src/cloud/surface/adaptive/scale_rows.h"
#include "src/cloud/surface/adaptive/scale_rules.h"
#include "src/cloud/surface/flying_pixel.h"
#include "src/core/internal/simd_rows.h"

namespace palpate { inline namespace v0 { namespace PALPATE_ISA_NAMESPACE {
namespace {

void begin_row(const FilterPass& pass, const ScaleLevel& level, int v) {
  const VecF zero = splat(0.0f);
  const float* const in = pass.in.row(v);
  float* const out = level.mean.row(v);
  for (int u = 0; u < level.width; u += kLanes) {
    const VecF z = load(in + u);
    Mask valid = z < kAnyDepth;
    if (pass.flying_gap > 0) valid &= ~is_flying(in + u, pass.in.stride, z, pass.flying_gap);
    store(out + u, select(valid, 1.0f / z, zero));
  }
}

void widen_row(const ScaleLevel& fine, int level, const ScaleLevel& coarse, int v) {
  const float tolerance = scale_tolerance(level);
  const float* const above = fine.mean.row(2 * v);
  const float* const below = fine.mean.row(2 * v + 1);
  float* const out = coarse.mean.row(v);
  for (int u = 0; u < coarse.width; u += kLanes) {
    const Pairs upper = load_pairs(above + 2 * u), lower = load_pairs(below + 2 * u);
    store(out + u, joined_cells(upper.first, upper.second, lower.first, lower.second, tolerance));
  }
}

/// Cells of a row that are done at once.
constexpr int kChunk = 64;

void predict_row(const ScaleLevel&, int level, const ScaleImage& from, const ScaleLevel& fine,
                 const ScaleImage& to, Columns columns, int v) {
  const float tolerance = scale_tolerance(level);
  for (int first = columns.left; first < columns.right; first += kChunk) {
    const int num = std::min(kChunk, columns.right - first);
    const float* const above = from.row(v - 1) + first;
    const float* const at = from.row(v) + first;
    const float* const below = from.row(v + 1) + first;
    const std::ptrdiff_t stride = from.stride;
    float lower[kChunk + 4 + kLanes], upper[kChunk + 4 + kLanes];  // halves, from column -2 on
    for (int i = 0; i < num + 4; i += kLanes) {
      const int u = i - 2;
      const Halves h = halves_of(load(above - stride + u), load(above + u), load(at + u),
                                 load(below + u), load(below + stride + u));
      store(lower + i, h.lower);
      store(upper + i, h.upper);
    }
    for (int u = 0; u < num; u += kLanes) {
      const VecF mean = load(at + u);
      const QuarterSlope across =
          quarter_slope(load(at + u - 1), mean, load(at + u + 1), tolerance);
      const QuarterSlope down = quarter_slope(load(above + u), mean, load(below + u), tolerance);
      const Mask has_plane = (mean > splat(0.0f)) & across.is_known & down.is_known;
      const auto predict = [&](const float* halves, VecF center, int row) {
        const Halves h = halves_of(load(halves), load(halves + 1), load(halves + 2),
                                   load(halves + 3), load(halves + 4));
        store_pairs(to.row(row) + 2 * (first + u),
                    {predicted_cell(h.lower, center - across.change, mean, has_plane),
                     predicted_cell(h.upper, center + across.change, mean, has_plane)});
      };
      predict(lower + u, mean - down.change, 2 * v);
      if (2 * v + 1 < fine.height) predict(upper + u, mean + down.change, 2 * v + 1);
    }
  }
}

/// Returns the most of two by two cells.
VecF max_of(const float* above, const float* below) {
  const Pairs upper = load_pairs(above), lower = load_pairs(below);
  return max(max(upper.first, upper.second), max(lower.first, lower.second));
}

void find_energy_row(const ScaleLevel* finer, const ScaleNoise& noise, const ScaleLevel& level,
                     Columns columns, int v) {
  const VecF zero = splat(0.0f), one = splat(1.0f);
  for (int first = columns.left; first < columns.right; first += kChunk) {
    const int num = std::min(kChunk, columns.right - first);
    float sums[kChunk + 2 + kLanes], weights[kChunk + 2 + kLanes];  // from column -1 on
    for (int i = 0; i < num + 2; i += kLanes) {
      VecF sum = zero, weight = zero;
      for (int row = -1; row <= 1; ++row) {
        const VecF share = row == 0 ? one + one : one;
        const VecF mean = load(level.mean.row(v + row) + first + i - 1);
        const VecF predicted = load(level.predicted.row(v + row) + first + i - 1);
        const Mask is_known = (mean > zero) & (predicted > zero);
        sum += select(is_known, share * energy_of(mean, predicted, noise), zero);
        weight += select(is_known, share, zero);
      }
      store(sums + i, sum);
      store(weights + i, weight);
    }
    for (int u = 0; u < num; u += kLanes) {
      const VecF sum = load(sums + u) + 2.0f * load(sums + u + 1) + load(sums + u + 2);
      const VecF weight = load(weights + u) + 2.0f * load(weights + u + 1) + load(weights + u + 2);
      VecF energy = excess_of(sum, weight, load(level.mean.row(v) + first + u), noise);
      if (finer != nullptr) {
        const int column = 2 * (first + u);
        energy = max(energy, max_of(finer->energy.row(2 * v) + column,
                                    finer->energy.row(2 * v + 1) + column));
      }
      store(level.energy.row(v) + first + u, energy);
    }
  }
}

void smooth_row(int number, const ScaleLevel* wider, const ScaleNoise& noise,
                const ScaleLevel& level, Columns columns, int v) {
  float* const energies = level.energy.row(v);
  const float* const means = level.mean.row(v);
  const float* const predicted = level.predicted.row(v);
  float* const smoothed = level.smoothed.row(v);
  if (wider != nullptr) {
    const float* const shared = wider->energy.row(v / 2);
    for (int u = columns.left / 2; 2 * u < columns.right; u += kLanes) {
      const VecF share = kFinerShare * load(shared + u);
      const Pairs own = load_pairs(energies + 2 * u);
      store_pairs(energies + 2 * u, {max(own.first, share), max(own.second, share)});
    }
    // The next image's wider cells read a cell beyond the end, and its vectors may not reach there.
    store(energies + level.width, splat(0.0f));
    store(energies + level.width + kLanes, splat(0.0f));
  }
  for (int u = columns.left; u < columns.right; u += kLanes) {
    const VecF mean = load(means + u), predicted_u = load(predicted + u);
    const VecF energy = load(energies + u);
    VecF detail = mean - predicted_u;
    if (number < kCalmLevels && is_any_set(is_kept(mean, predicted_u, energy))) {
      detail = calm_detail(number, means + u, predicted + u, level.mean.stride, noise);
    }
    store(smoothed + u,
          smoothed_cell(mean, detail, predicted_u, load(smoothed + u), energy, noise));
  }
}

void finish_row(const ScaleLevel& level, const FilterPass& pass, Columns columns, int v) {
  const VecF nan = splat(std::numeric_limits<float>::quiet_NaN());
  const VecF none = splat(kNoDepth), far = splat(kFar), zero = splat(0.0f);
  const float* const smoothed = level.smoothed.row(v);
  const float* const in = pass.in.row(v);
  float* const out = pass.out + v * pass.in.stride;
  float* const depth = pass.depth + static_cast<std::ptrdiff_t>(v) * pass.in.width;
  for (int u = columns.left; u < columns.right; u += kLanes) {
    const VecF w = load(smoothed + u), z = load(in + u);
    const Mask valid = (w > zero) & (z < kAnyDepth);
    const VecF result = select(valid, 1.0f / w, none);
    store(out + u, result);  // lanes beyond the width are margin and stay kNoDepth
    store_first(depth + u, select(valid, result, select(z > none, far, nan)), pass.in.width - u);
  }
}

}  // namespace

ScaleRows scale_rows() {
  return {begin_row, widen_row, predict_row, find_energy_row, smooth_row, finish_row};
}

}}}  // namespace palpate::v0::PALPATE_ISA_NAMESPACE
