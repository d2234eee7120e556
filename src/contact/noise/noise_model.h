// The noise of a surface as a query meets it. Each camera has a noise by scale: white noise of the
// cells of level k, which are 2^k pixels wide, for all levels. A detail of a level is what the next
// wider one does not tell; its standard deviation, by depth, comes from the frame (adaptive
// smoothing learns it) or from the camera's noise and its correlation (SurfaceOptions::noise).
//
// A smoothed surface has lost the details of its finer scales, but no filter loses the mean of the
// noise over wide windows: what a scale has lost is left in the next one, as the mean of four.
// The scales that are left at a place are seen in the field itself. Shared by host and device.
#pragma once

#include "src/cloud/internal/frame_noise.h"
#include "src/field/internal/field_sampler.h"

namespace palpate { inline namespace v0 {

/// The noise of a surface, as a GPU reads it.
struct SurfaceNoise {
  FrameNoise frame;
  std::int32_t is_known = 0;
  float share = 1;  ///< that counts, of a blend of two frames

  friend bool operator==(const SurfaceNoise&, const SurfaceNoise&) = default;
};
/// Returns it by the noise of a field; null: unknown.
inline SurfaceNoise surface_noise(const FrameNoise* frame, double share = 1) {
  SurfaceNoise noise;
  if (frame != nullptr) noise.frame = *frame;
  noise.is_known = frame != nullptr;
  noise.share = static_cast<float>(share);
  return noise;
}

/// Variances of the noise of all scales, m2 of depth.
struct NoiseScales {
  float variance[kNumNoiseLevels] = {};
};

/// Returns them at a depth. Noise that is nearly white at one scale is so at the next wider one:
/// the excess of a level's variance over what it would be of white noise grows at most fourfold.
/// More is shape, which a stream's noise has no part of.
PALPATE_HOSTDEV inline NoiseScales noise_scales(const FrameNoise& noise, float z) {
  constexpr float white = 0.25f, max_growth = 4;
  NoiseScales scales;
  float before = 0, share = 1e9f;  // variance of the finer level, and its share that may count
  for (int k = 0; k < kNumNoiseLevels; ++k) {
    const float sd = noise.base[k] + noise.growth[k] * z * z;
    float variance = sd * sd * static_cast<float>(1 / kDetailShare);
    if (k > 0) {
      const float upper = share * before, lower = white * before;
      variance = variance > upper && !noise.is_whole ? upper : variance;
      variance = variance < lower ? lower : variance;
      if (before > 0) share = white + max_growth * (variance / before - white);
    }
    scales.variance[k] = variance - white * before;
    before = variance;
  }
  return scales;
}

/// Cells of one level around some elements.
struct CellWindow {
  int level = 0;
  int left = 0, top = 0, right = 0, bottom = 0;  ///< first ones, and last ones
};

/// Returns the window of the next wider level that holds all of its cells.
PALPATE_HOSTDEV inline CellWindow wider_cells(const CellWindow& window) {
  return {window.level + 1, window.left >> 1, window.top >> 1, window.right >> 1,
          window.bottom >> 1};
}

/// Returns the step from one to the next of the cells of a row, or column, at which the field is
/// looked at: there are eight at most.
PALPATE_HOSTDEV inline int step_over(int first, int last) { return 1 + (last - first) / 8; }

/// Sums over the second differences of inverse depth that a field shows.
struct SeenBends {
  float sum = 0, num = 0;

  /// Adds those at a cell of a level, as shares of what noise of this variance would show. Limited,
  /// as edges and shape are not noise.
  PALPATE_HOSTDEV void add(const FieldGrid& grid, const FieldPixels& pixels, int level, int u,
                           int v, float variance) {
    constexpr float limit = 4;
    const auto last = [level](float size) {
      return ((static_cast<int>(size) + (1 << level) - 1) >> level) - 1;
    };
    if (u < 1 || v < 1 || u >= last(grid.width) || v >= last(grid.height)) return;
    const auto inverse_depth = [&](std::ptrdiff_t pixel) {
      const float offset = pixels.planes[2 * pixel];
      return offset > 0 ? pixels.planes[2 * pixel + 1] / offset : 0.0f;
    };
    const std::ptrdiff_t pixel = grid.start[level] + std::ptrdiff_t{v} * grid.stride + u;
    const float at = inverse_depth(pixel);
    if (!(at > 0)) return;
    const float scale = 1 / (6 * variance * at * at * at * at);
    const std::ptrdiff_t steps[] = {1, grid.stride};
    for (const std::ptrdiff_t apart : steps) {
      const float before = inverse_depth(pixel - apart), after = inverse_depth(pixel + apart);
      if (!(before > 0) || !(after > 0)) continue;
      const float bend = before + after - 2 * at, square = bend * bend * scale;
      sum += square < limit ? square : limit;
      num += 1;
    }
  }

  /// Returns the share of a level's noise that is left.
  PALPATE_HOSTDEV float share() const {
    constexpr float normal_mean = 0.92f;  // of a limited square of noise
    const float share = num > 0 ? sum / (normal_mean * num) : 1.0f;
    return share < 1 ? share : 1.0f;
  }
};

/// Returns the share of a level's noise that the field shows in a window. `variance`: the noise of
/// the level's cells.
inline float noise_left(const FieldGrid& grid, const FieldPixels& pixels, const CellWindow& window,
                        float variance) {
  if (window.level > grid.last_level) return 1;
  const int step_u = step_over(window.left, window.right);
  const int step_v = step_over(window.top, window.bottom);
  SeenBends bends;
  for (int v = window.top; v <= window.bottom; v += step_v) {
    for (int u = window.left; u <= window.right; u += step_u) {
      bends.add(grid, pixels, window.level, u, v, variance);
    }
  }
  return bends.share();
}

/// Levels up to this one are smoothed by filters; its own noise is then that of the next one.
inline constexpr int kLastSmoothed = 4;

/// Turns the noise of cells into that of the nodes of grids, from the window's level on. What a
/// scale has lost is left in the next one, and all that is finer than the window is lost. A spline
/// over nodes as far apart as the cells has a third of their variance at one place, and one over
/// nodes half as far apart with four times the variance a fifth more. Both have the same over wide
/// windows. A scale leaves half the one and half the other. left_of(window, variance)
/// is noise_left.
template <class LeftOf>
PALPATE_HOSTDEV inline void place_scales(CellWindow window, const LeftOf& left_of,
                                         NoiseScales& scales) {
  NoiseScales nodes;
  const int first = window.level < kNumNoiseLevels ? window.level : kNumNoiseLevels - 1;
  float cells = 0, lost = 0;  // noise of the finer scales in a cell: all, and what is lost
  for (int k = 0; k < kNumNoiseLevels; ++k) {
    const float own = lost + scales.variance[k];
    cells += scales.variance[k];
    float left = 1;
    if (k < first) {
      left = 0;
    } else if (k <= kLastSmoothed && own > 0) {
      left = left_of(window, cells);
    }
    const float kept = left * own;
    nodes.variance[k] += k > first ? 0.5f * kept : kept;
    if (k > first) nodes.variance[k - 1] += 2 * kept;
    lost = 0.25f * (own - kept);
    if (k == kLastSmoothed && k >= first) {
      nodes.variance[k] += 4 * lost;
      lost = 0;
    }
    cells *= 0.25f;
    if (k >= window.level) window = wider_cells(window);
  }
  scales = nodes;
}

/// Returns the number of grids that have noise, from that of a level on.
PALPATE_HOSTDEV inline int num_noise_grids(int first) {
  return first < kNumNoiseLevels ? kNumNoiseLevels - first : 1;
}
/// Returns the variance of the nodes of a grid's level.
PALPATE_HOSTDEV inline float node_variance(const NoiseScales& scales, int level) {
  constexpr int last = kNumNoiseLevels - 1;
  if (level <= last) return scales.variance[level];
  return scales.variance[last] * static_cast<float>(1.0 / (1 << 2 * (level - last)));
}

}}  // namespace palpate::v0
