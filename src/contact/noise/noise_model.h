// The noise of a surface as a query meets it. Each camera has a noise by scale: white noise of the
// cells of level k, which are 2^k pixels wide, for all levels. A detail of a level is what the next
// wider one does not tell; its standard deviation, by depth, comes from the frame (adaptive
// smoothing learns it) or from the camera's noise and its correlation (SurfaceOptions::noise).
//
// A smoothed surface has lost the details of its finer scales, but no filter loses the mean of the
// noise over wide windows: what a scale has lost is left in the next one, as the mean of four.
// The scales that are left at a place are seen in the field itself. Shared by host and device.
#pragma once

#include "palpate/field/depth_field.h"
#include "src/cloud/internal/frame_noise.h"

namespace palpate { inline namespace v0 {

/// Variances of the noise of all scales, m2 of depth.
struct NoiseScales {
  float variance[kNumNoiseLevels] = {};
};

/// Returns them at a depth. Noise that is nearly white at one scale is so at the next wider one:
/// the excess of a level's variance over what it would be of white noise grows at most fourfold.
/// More is shape.
PALPATE_HOSTDEV inline NoiseScales noise_scales(const FrameNoise& noise, float z) {
  constexpr float white = 0.25f, max_growth = 4;
  NoiseScales scales;
  float before = 0, share = 1e9f;  // variance of the finer level, and its share that may count
  for (int k = 0; k < kNumNoiseLevels; ++k) {
    const float sd = noise.base[k] + noise.growth[k] * z * z;
    float variance = sd * sd * static_cast<float>(1 / kDetailShare);
    if (k > 0) {
      const float upper = share * before, lower = white * before;
      variance = variance > upper ? upper : variance;
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

/// Returns the share of a level's noise that the field shows in a window: the mean square of second
/// differences of inverse depth, limited as edges and shape are not noise. `variance`: the noise of
/// the level's cells.
PALPATE_HOSTDEV inline float noise_left(const DepthFieldView& field, const CellWindow& window,
                                        float variance) {
  constexpr int max_steps = 8;          // cells each way
  constexpr float limit = 4;            // variances
  constexpr float normal_mean = 0.92f;  // of a limited square of noise
  if (window.level >= field.num_levels) return 1;
  const DepthFieldLevel& level = field.levels[window.level];
  const auto inverse_depth = [&](std::ptrdiff_t pixel) {
    const float offset = level.planes[2 * pixel];
    return offset > 0 ? level.planes[2 * pixel + 1] / offset : 0.0f;
  };
  const auto step_over = [](int first, int last) { return 1 + (last - first) / max_steps; };
  const int step_u = step_over(window.left, window.right);
  const int step_v = step_over(window.top, window.bottom);
  float sum = 0, num = 0;
  for (int v = window.top; v <= window.bottom; v += step_v) {
    for (int u = window.left; u <= window.right; u += step_u) {
      if (u < 1 || v < 1 || u >= level.width - 1 || v >= level.height - 1) continue;
      const std::ptrdiff_t pixel = std::ptrdiff_t{v} * level.stride + u;
      const float at = inverse_depth(pixel);
      if (!(at > 0)) continue;
      const float scale = 1 / (6 * variance * at * at * at * at);
      const std::ptrdiff_t steps[] = {1, level.stride};
      for (const std::ptrdiff_t apart : steps) {
        const float before = inverse_depth(pixel - apart), after = inverse_depth(pixel + apart);
        if (!(before > 0) || !(after > 0)) continue;
        const float bend = before + after - 2 * at, square = bend * bend * scale;
        sum += square < limit ? square : limit;
        num += 1;
      }
    }
  }
  const float share = num > 0 ? sum / (normal_mean * num) : 1.0f;
  return share < 1 ? share : 1.0f;
}

/// Levels up to this one are smoothed by filters; its own noise is then that of the next one.
inline constexpr int kLastSmoothed = 4;

/// Turns the noise of cells into that of the nodes of grids, from the window's level on. What a
/// scale has lost is left in the next one, and all that is finer than the window is lost. A spline
/// over nodes as far apart as the cells has a third of their variance at one place, and one over
/// nodes half as far apart with four times the variance a fifth more. Both have the same over wide
/// windows. What is left of a scale is half the one and half the other.
PALPATE_HOSTDEV inline void place_scales(const DepthFieldView& field, CellWindow window,
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
      left = noise_left(field, window, cells);
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
    if (k >= window.level) {
      window = {window.level + 1, window.left >> 1, window.top >> 1, window.right >> 1,
                window.bottom >> 1};
    }
  }
  scales = nodes;
}

}}  // namespace palpate::v0
