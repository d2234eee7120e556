// The depth image of a camera, laid out for searches of the nearest surface: the depth of each
// pixel, and the nearest and farthest depth of squares of 4, 16, 64 and 256 pixels. A square that
// is too far away is passed over with all that it covers.
#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include "palpate/field/depth_field.h"

namespace palpate { inline namespace v0 {

/// Depth of a pixel without surface: its ray is free, m.
inline constexpr float kNoSurface = 1e9f;

/// Least depths of square windows that overlap, so that a few of them cover any part of an image
/// closely. Windows of level k are 16 * 2^k pixels wide and start at every fourth of that.
struct DepthWindows {
  static constexpr int kLevels = 8;
  static constexpr int kStep = 4;      ///< pixels from window to window at level 0
  static constexpr int kMaxSteps = 7;  ///< that two windows cover wherever they start

  const float* nearest = nullptr;  ///< m, of all levels; null: not made
  std::int32_t first[kLevels] = {}, wide[kLevels] = {}, high[kLevels] = {};
  std::int32_t num_levels = 0;
  std::int32_t whole = -1;  ///< number of the window that is the whole image; -1: there is none

  /// Numbers in the array.
  std::size_t num_places() const {
    return static_cast<std::size_t>(first[num_levels - 1] +
                                    wide[num_levels - 1] * high[num_levels - 1]);
  }
};

/// Input of searches; non-owning, trivially copyable. Level k has squares of 4^k x 4^k pixels.
/// The squares of one level lie in blocks of 4 x 4, which are the parts of one square of the next
/// level.
struct ClearanceImage {
  static constexpr int kLevels = 5;
  static constexpr int kPerBlock = 16;

  const float* nearest[kLevels] = {};   ///< least depth of the surfaces in a square, m
  const float* farthest[kLevels] = {};  ///< its greatest; at level 0 the same array
  std::int32_t blocks_wide[kLevels] = {}, blocks_high[kLevels] = {};
  std::int32_t width = 0, height = 0;
  float fx = 0, fy = 0, cx = 0, cy = 0;
  float per_fx = 0, per_fy = 0;
  /// Solid space behind a surface, along the viewing ray, m; kNoSurface: however deep.
  float solid_behind = kNoSurface;
  /// Space outside of the image is solid, as in SurfaceView::seen_free. Else it is free.
  std::int32_t is_blocked_outside = 0;
  /// Inward unit normals of the planes through the eye and the border of the image.
  float border[4][3] = {};
  DepthWindows windows;

  /// Numbers in an array of a level.
  std::size_t num_places(int level) const {
    return static_cast<std::size_t>(blocks_wide[level] * blocks_high[level] * kPerBlock);
  }
  /// Number of a square in the arrays of its level.
  PALPATE_HOSTDEV std::int32_t place(int level, std::int32_t column, std::int32_t row) const {
    return ((row >> 2) * blocks_wide[level] + (column >> 2)) * kPerBlock + (row & 3) * 4 +
           (column & 3);
  }
};

/// Describes the image of a field that is known as a whole; its arrays are still to be made.
/// `is_blocked`: the field is one of seen-free space, and outside of the image nothing is free.
ClearanceImage image_of(const DepthFieldView& field, bool is_blocked);

/// Writes the depths of a block of 4 x 4 pixels, from the planes along their rays.
PALPATE_HOSTDEV inline void take_depths(const ClearanceImage& image, const DepthFieldLevel& pixels,
                                        std::int32_t block_column, std::int32_t block_row,
                                        float* nearest) {
  const float outside = image.is_blocked_outside != 0 ? 0 : kNoSurface;
  float* to = nearest + (block_row * image.blocks_wide[0] + block_column) * 16;
  for (std::int32_t v = 4 * block_row; v < 4 * block_row + 4; ++v) {
    for (std::int32_t u = 4 * block_column; u < 4 * block_column + 4; ++u) {
      float depth = outside;
      if (u < pixels.width && v < pixels.height) {
        const float* const plane = pixels.planes + 2 * (v * pixels.stride + u);
        depth = plane[1] > 0 ? plane[0] / plane[1] : kNoSurface;
        depth = depth < kNoSurface ? depth : kNoSurface;
      }
      *to++ = depth;
    }
  }
}

/// Writes the depths of a square of a level above 0, from its block of the level below.
PALPATE_HOSTDEV inline void merge_depths(const ClearanceImage& image, int level,
                                         std::int32_t column, std::int32_t row, float* nearest,
                                         float* farthest) {
  float least = kNoSurface, most = 0;
  if (column < image.blocks_wide[level - 1] && row < image.blocks_high[level - 1]) {
    constexpr int kPerBlock = ClearanceImage::kPerBlock;
    const std::int32_t parts = (row * image.blocks_wide[level - 1] + column) * kPerBlock;
    for (std::int32_t i = parts; i < parts + kPerBlock; ++i) {
      const float near = image.nearest[level - 1][i], far = image.farthest[level - 1][i];
      least = near < least ? near : least;
      most = far > most ? far : most;
    }
  }
  const std::int32_t at = image.place(level, column, row);
  nearest[at] = least;
  farthest[at] = most;
}

/// A part of the making of windows: each is the least of four, which lie `apart` and start at every
/// `step` of those that they are made from.
struct WindowMerge {
  std::int32_t wide = 0, high = 0;  ///< there are, to merge
  std::int32_t step = 1, apart = 1;

  PALPATE_HOSTDEV std::int32_t merged_wide() const { return (wide - 1) / step + 1; }
  PALPATE_HOSTDEV std::int32_t merged_high() const { return (high - 1) / step + 1; }
  PALPATE_HOSTDEV float least(const float* from, std::int32_t column, std::int32_t row) const {
    const std::int32_t left = column * step, top = row * step;
    const std::int32_t right = left + apart < wide ? left + apart : left;
    const float* const upper = from + top * wide;
    const float* const lower = top + apart < high ? upper + apart * wide : upper;
    const float above = upper[left] < upper[right] ? upper[left] : upper[right];
    const float below = lower[left] < lower[right] ? lower[left] : lower[right];
    return above < below ? above : below;
  }
};

/// Makes the windows of an image: copy(squares) writes the nearest depths of its squares of 4 x 4
/// pixels in rows, merge(part, from, to) merges. `scratch` has room for the squares twice.
template <class Copy, class Merge>
void make_windows(const ClearanceImage& image, float* scratch, float* windows, const Copy& copy,
                  const Merge& merge) {
  const DepthWindows& to = image.windows;
  const std::int32_t wide = to.wide[0], high = to.high[0];
  float* const pairs = scratch + wide * high;
  copy(scratch);
  merge(WindowMerge{wide, high, 1, 1}, scratch, pairs);
  merge(WindowMerge{wide, high, 1, 2}, pairs, windows);
  for (int k = 1; k < to.num_levels; ++k) {
    merge(WindowMerge{to.wide[k - 1], to.high[k - 1], 2, 4}, windows + to.first[k - 1],
          windows + to.first[k]);
  }
}

/// Owns the arrays of a ClearanceImage in host memory.
class ClearanceFrame {
 public:
  /// Recomputes all from a field in host memory. Allocates for the first image of its size.
  /// O(pixels): about 1 ms for 640 x 480.
  void update(const DepthFieldView& field, bool is_blocked);
  const ClearanceImage& image() const { return image_; }
  /// DepthFieldView::stamp of the field, 0: none.
  std::uint64_t stamp() const { return stamp_; }

 private:
  ClearanceImage image_;
  std::uint64_t stamp_ = 0;
  std::vector<float> nearest_[ClearanceImage::kLevels], farthest_[ClearanceImage::kLevels];
  std::vector<float> windows_, squares_;
};

}}  // namespace palpate::v0
