#include "src/contact/clearance/clearance_image.h"

#include <algorithm>
#include <cmath>

namespace palpate { inline namespace v0 {
namespace {

constexpr int kLevels = ClearanceImage::kLevels, kPerBlock = ClearanceImage::kPerBlock;

/// Writes the depths of 4 x 4 pixels, from planes along their rays.
void take_depths(const DepthFieldLevel& level, int first_u, int first_v, float outside, float* to) {
  for (int v = first_v; v < first_v + 4; ++v) {
    for (int u = first_u; u < first_u + 4; ++u) {
      float depth = outside;
      if (u < level.width && v < level.height) {
        const float* const plane = level.planes + 2 * (v * level.stride + u);
        depth = plane[1] > 0 ? plane[0] / plane[1] : kNoSurface;
        depth = std::min(depth, kNoSurface);
      }
      *to++ = depth;
    }
  }
}

/// Sets a border's plane through the eye; `sign` is that of the inward axis.
void set_border(float (&normal)[3], int axis, float slope, float sign) {
  const float length = std::sqrt(1 + slope * slope);
  normal[axis] = sign / length;
  normal[1 - axis] = 0;
  normal[2] = -sign * slope / length;
}

}  // namespace

void ClearanceFrame::update(const DepthFieldView& field, bool is_blocked) {
  const DepthFieldLevel& pixels = field.levels[0];
  ClearanceImage& to = image_;
  to.width = pixels.width;
  to.height = pixels.height;
  const Intrinsics& k = field.intrinsics;
  to.fx = static_cast<float>(k.fx);
  to.fy = static_cast<float>(k.fy);
  to.cx = static_cast<float>(k.cx);
  to.cy = static_cast<float>(k.cy);
  to.per_fx = 1 / to.fx;
  to.per_fy = 1 / to.fy;
  to.is_blocked_outside = is_blocked ? 1 : 0;
  // A surface ends at twice its thickness: up to there a tool is pushed out of its front or its
  // back, or counts as volume.
  to.solid_behind = is_blocked || field.unseen() == UnseenSpace::solid
                        ? kNoSurface
                        : 2 * std::abs(field.thickness);
  set_border(to.border[0], 0, (-0.5f - to.cx) * to.per_fx, 1);
  set_border(to.border[1], 0, (static_cast<float>(to.width) - 0.5f - to.cx) * to.per_fx, -1);
  set_border(to.border[2], 1, (-0.5f - to.cy) * to.per_fy, 1);
  set_border(to.border[3], 1, (static_cast<float>(to.height) - 0.5f - to.cy) * to.per_fy, -1);

  int blocks_wide = (to.width + 3) / 4, blocks_high = (to.height + 3) / 4;
  const float outside = is_blocked ? 0 : kNoSurface;
  for (int level = 0; level < kLevels; ++level) {
    const std::size_t size = static_cast<std::size_t>(blocks_wide * blocks_high * kPerBlock);
    nearest_[level].resize(size);
    if (level > 0) farthest_[level].resize(size);
    to.blocks_wide[level] = blocks_wide;
    float* const nearest = nearest_[level].data();
    float* const farthest = level > 0 ? farthest_[level].data() : nearest;
    to.nearest[level] = nearest;
    to.farthest[level] = farthest;
    if (level == 0) {
      for (int row = 0; row < blocks_high; ++row) {
        for (int column = 0; column < blocks_wide; ++column) {
          take_depths(pixels, 4 * column, 4 * row, outside,
                      nearest + (row * blocks_wide + column) * kPerBlock);
        }
      }
    } else {
      const int parts_wide = to.blocks_wide[level - 1];
      const int parts_high =
          static_cast<int>(nearest_[level - 1].size()) / (parts_wide * kPerBlock);
      for (int row = 0; row < 4 * blocks_high; ++row) {
        for (int column = 0; column < 4 * blocks_wide; ++column) {
          const int at = to.place(level, column, row);
          float least = kNoSurface, most = 0;
          if (row < parts_high && column < parts_wide) {
            const auto parts = static_cast<std::size_t>((row * parts_wide + column) * kPerBlock);
            const float* const near = to.nearest[level - 1] + parts;
            const float* const far = to.farthest[level - 1] + parts;
            for (int i = 0; i < kPerBlock; ++i) {
              least = std::min(least, near[i]);
              most = std::max(most, far[i]);
            }
          }
          nearest[at] = least;
          farthest[at] = most;
        }
      }
    }
    blocks_wide = (blocks_wide + 3) / 4;
    blocks_high = (blocks_high + 3) / 4;
  }
  stamp_ = field.stamp;
}

}}  // namespace palpate::v0
