// Pixels that were measured as farther than `max_depth`. Their rays are free up to there, unless
// the sensor erred: a real camera has such pixels in the middle of near surfaces, up to 65 m away.
// A group of connected ones (8 neighbors) is an error if it is small or lies inside one surface.
// Rules are shared by host and device.
#pragma once

#include <algorithm>
#include <cstdint>
#include <memory>
#include <vector>

#include "palpate/cloud/point_cloud.h"
#include "src/cloud/surface/surface_kernels.h"

namespace palpate { inline namespace v0 {

inline constexpr int kMinFarPixels = 9;  ///< pixels of a group that is no error
/// Largest width and height of an error, pixels: those of the widest hole that is filled
/// (DepthFieldOptions::fill_levels up to 5).
inline constexpr int kFarSide = 32;
/// Share of the depth from one pixel to the next on one surface, as in depth fields.
inline constexpr float kFarSlope = 0.012f;

/// True if a group of `num` pixels, in a box of at most `side` pixels a side, is an error. The
/// measurements beside it lie between `nearest` and `farthest`, m; kNoDepth and 0: there are none.
PALPATE_HOSTDEV inline bool is_far_error(int num, int side, float nearest, float farthest) {
  if (num < kMinFarPixels) return true;
  if (side > kFarSide) return false;
  return !(farthest - nearest > kFarSlope * static_cast<float>(side + 1) * nearest);
}

/// Finds the errors of an image, row by row, in runs of pixels.
class FarGroups {
 public:
  FarGroups(int width, int height);

  /// One bit a pixel, written anew for each image: measured as far. Rows begin at a word.
  std::uint64_t* bits() { return bits_.data(); }

  /// Replaces kFarDepth by kNoDepth where it is an error, inside the window of a padded image whose
  /// bits are there. O(far pixels), and the rows of the window.
  void drop_errors(float* depth, std::ptrdiff_t stride, const PixelWindow& window);

 private:
  /// Neighboring pixels of a row. The first run of a group also knows the group.
  struct Run {
    std::int32_t group;  // its first run
    std::uint16_t row, left, right;
    std::uint16_t group_left, group_right, group_bottom;
    std::int32_t num;         // pixels of the group
    float nearest, farthest;  // beside the group

    int side() const { return std::max(group_right - group_left, group_bottom - row + 1); }
  };

  template <class Use>
  void for_runs_of_row(int v, const PixelWindow& area, const Use& use) const;
  std::int32_t group_of(std::int32_t run);
  void find_runs(const PixelWindow& area);
  void measure_groups();
  void look_beside(const float* depth, std::ptrdiff_t stride);

  int width_, height_, words_per_row_;
  std::vector<std::uint64_t> bits_;
  std::unique_ptr<Run[]> runs_;  // room for those of any image
  std::int32_t num_runs_ = 0;
};

}}  // namespace palpate::v0
