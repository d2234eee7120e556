// The arithmetic of a depth field's pixels and the places of its levels in memory: one text for CPU
// and GPU, whose loops differ.
#pragma once

#include <cmath>
#include <cstddef>

#include "palpate/core/hostdev.h"
#include "palpate/core/result.h"
#include "palpate/field/depth_field.h"

namespace palpate {

/// A pixel's tangent plane; no surface if the slope is 0.
struct alignas(8) TangentPlane {
  // Where there is no surface: so far in front that no sphere is near.
  static constexpr float kFreeOffset = 10.0f;

  float offset = kFreeOffset, slope = 0;

  PALPATE_HOSTDEV bool is_surface() const { return slope > 0; }
  PALPATE_HOSTDEV float inverse_depth() const { return slope / offset; }
};
static_assert(sizeof(TangentPlane) == 2 * sizeof(float));  // read as pairs of numbers

/// Of the point at depth z > 0 whose plane passes the eye at the distance -(p . n).
PALPATE_FORMULA TangentPlane tangent_plane(float x, float y, float z, float nx, float ny,
                                           float nz) {
  // A surface seen so aslant that its plane passes the eye closer than this share of its depth
  // counts as steep as that.
  constexpr float kLeastOffset = 0.02f;
  const float d = -(x * nx + y * ny + z * nz), least = kLeastOffset * z;
  const float offset = d < least ? least : d;
  return {offset, offset / z};
}

/// Pixels of level k belong to one surface if their depths differ by less than this share: a wider
/// pixel reaches farther along a slanted surface.
PALPATE_HOSTDEV inline float tolerance_of(int level) {
  const float share = 0.012f * static_cast<float>(1 << level);
  return share < 0.05f ? share : 0.05f;
}

/// There is a step where the plane of a neighbour misses the surface point of a pixel by more,
/// metres.
PALPATE_HOSTDEV inline float step_limit_of(int level) {
  const float limit = 0.006f * static_cast<float>(1 << level);
  return limit < 0.025f ? limit : 0.025f;
}

/// Which of a few pixels a wider one stands for.
enum class Choice {
  majority,  ///< the surface, or absence of one, that most of them show; the nearest if undecided
  nearest,   ///< any surface, the nearest one
  farthest,  ///< any surface, the farthest one: what goes on behind an edge
};

/// Mean of the planes of one surface among four pixels with positive weights.
PALPATE_FORMULA TangentPlane merge(const TangentPlane (&pixels)[4], const float (&weights)[4],
                                   float tolerance, Choice choice) {
  float w[4];
  for (int i = 0; i < 4; ++i) w[i] = pixels[i].inverse_depth();
  const auto is_same = [tolerance](float a, float b) {
    return std::abs(a - b) <= tolerance * (a < b ? b : a) && (a > 0) == (b > 0);
  };
  float best = -1;  // the chosen pixel's w
  int best_votes = 0;
  for (int i = 0; i < 4; ++i) {
    if (choice != Choice::majority && w[i] <= 0) continue;
    int votes = 0;
    for (int j = 0; j < 4; ++j) votes += choice == Choice::majority && is_same(w[i], w[j]);
    const bool is_better = choice == Choice::farthest ? w[i] < best : w[i] > best;
    if (best < 0 || votes > best_votes || (votes == best_votes && is_better)) {
      best = w[i];
      best_votes = votes;
    }
  }
  if (best <= 0) return {};
  TangentPlane mean{0, 0};
  float total = 0;
  for (int i = 0; i < 4; ++i) {
    if (!is_same(w[i], best)) continue;
    mean.offset += weights[i] * pixels[i].offset;
    mean.slope += weights[i] * pixels[i].slope;
    total += weights[i];
  }
  return {mean.offset / total, mean.slope / total};
}

/// One pixel of two by two; at an odd end the last one counts twice.
PALPATE_FORMULA TangentPlane widened(const TangentPlane (&pixels)[4], int level, Choice choice) {
  constexpr float kEqual[4] = {1, 1, 1, 1};
  return merge(pixels, kEqual, tolerance_of(level), choice);
}

/// What the next wider level, `level`, knows where a pixel has no surface; of its four pixels
/// around the centre of that one, the nearest comes first and the farthest last.
PALPATE_FORMULA TangentPlane interpolated(const TangentPlane (&pixels)[4], int level) {
  constexpr float kBilinear[4] = {9, 3, 3, 1};
  return merge(pixels, kBilinear, tolerance_of(level), Choice::farthest);
}
/// The second nearest of `num` wider columns to column u (or rows); the nearest is u / 2.
PALPATE_HOSTDEV inline int second_nearest(int u, int num) {
  const int at = u / 2 + (u % 2 ? 1 : -1);
  return at < 0 ? 0 : (at >= num ? num - 1 : at);
}

/// Do the nine planes around a pixel not belong to one smooth surface? Its own is rows[1][1].
template <class Rows>
PALPATE_FORMULA bool has_step(const Rows& rows, float limit) {
  const TangentPlane centre = rows[1][1];
  const float depth = centre.offset / (centre.slope < 1e-6f ? 1e-6f : centre.slope);
  float worst = 0;
  for (int row = 0; row < 3; ++row) {
    for (int column = 0; column < 3; ++column) {
      const TangentPlane plane = rows[row][column];
      const float miss = std::abs(plane.offset - depth * plane.slope);
      worst = worst < miss ? miss : worst;
    }
  }
  return worst > limit;
}

/// Of a tile without any surface.
PALPATE_FORMULA DepthTile empty_tile() { return {1e30f, 1.0f}; }
PALPATE_FORMULA DepthTile join(const DepthTile& a, const DepthTile& b) {
  return {b.nearest < a.nearest ? b.nearest : a.nearest,
          b.least_slope < a.least_slope ? b.least_slope : a.least_slope};
}
/// Of one pixel of level 0.
PALPATE_FORMULA DepthTile tile_of(const TangentPlane& plane) {
  return plane.is_surface() ? DepthTile{plane.offset / plane.slope, plane.slope} : empty_tile();
}

/// Farther out than this beyond the image no place is looked at for steps.
inline constexpr int kStepBorder = DepthFieldLevel::kBorder - 2;

/// Where the levels of a field lie: all of one stride, one below the other, each with its border.
struct PyramidLayout {
  struct Level {
    int width = 0, height = 0;
    int first_row = 0;  ///< of its border
  };
  Level levels[DepthFieldView::kMaxLevels];
  int num_levels = 0;
  int stride = 0;
  int num_rows = 0;

  std::size_t num_pixels() const {
    return static_cast<std::size_t>(num_rows) * static_cast<std::size_t>(stride);
  }
  /// Of pixel (0, 0) of a level.
  PALPATE_HOSTDEV std::ptrdiff_t origin(int level) const {
    return static_cast<std::ptrdiff_t>(levels[level].first_row + DepthFieldLevel::kBorder) *
               stride +
           DepthFieldLevel::kBorder;
  }
  // Four pixels are read where three are needed, and bytes four at a time.
  std::size_t num_planes() const { return num_pixels() + 1; }
  std::size_t num_steps() const { return num_pixels() + 3; }
  int tiles_wide() const { return tiles_over(levels[0].width); }
  int tiles_high() const { return tiles_over(levels[0].height); }
  std::size_t num_tiles() const {
    return static_cast<std::size_t>(tiles_wide()) * static_cast<std::size_t>(tiles_high());
  }
  /// How queries see the levels, wherever their arrays are.
  DepthFieldView view(const TangentPlane* planes, const std::uint8_t* is_step,
                      const DepthTile* tiles, const DepthFieldOptions& options) const;
  /// Over how many levels holes are filled.
  int num_filled(const DepthFieldOptions& options) const;

 private:
  static int tiles_over(int size) {
    return (size + DepthFieldView::kTileSize - 1) / DepthFieldView::kTileSize;
  }
};

/// Errors: as DepthField::create.
Result<PyramidLayout> pyramid_layout(int width, int height, const DepthFieldOptions& options);

}  // namespace palpate
