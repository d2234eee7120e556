#include "src/contact/clearance/clearance_image.h"

#include <algorithm>
#include <cmath>

namespace palpate { inline namespace v0 {
namespace {

constexpr int kLevels = ClearanceImage::kLevels;

/// Sets a border's plane through the eye; `sign` is that of the inward axis.
void set_border(float (&normal)[3], int axis, float slope, float sign) {
  const float length = std::sqrt(1 + slope * slope);
  normal[axis] = sign / length;
  normal[1 - axis] = 0;
  normal[2] = -sign * slope / length;
}

}  // namespace

ClearanceImage image_of(const DepthFieldView& field, bool is_blocked) {
  const DepthFieldLevel& pixels = field.levels[0];
  ClearanceImage to;
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
  int wide = to.width, high = to.height;
  for (int level = 0; level < kLevels; ++level) {
    to.blocks_wide[level] = wide = (wide + 3) / 4;
    to.blocks_high[level] = high = (high + 3) / 4;
  }
  DepthWindows& windows = to.windows;
  wide = to.blocks_wide[0];
  high = to.blocks_high[0];
  for (std::int32_t size = 0; windows.num_levels < DepthWindows::kLevels;) {
    const int level = windows.num_levels++;
    windows.first[level] = size;
    windows.wide[level] = wide;
    windows.high[level] = high;
    size += wide * high;
    if (4 << level >= std::max(to.blocks_wide[0], to.blocks_high[0])) {
      windows.whole = windows.first[level];
      break;
    }
    wide = (wide + 1) / 2;
    high = (high + 1) / 2;
  }
  return to;
}

void ClearanceFrame::update(const DepthFieldView& field, bool is_blocked) {
  ClearanceImage& to = image_ = image_of(field, is_blocked);
  for (int level = 0; level < kLevels; ++level) {
    nearest_[level].resize(to.num_places(level));
    if (level > 0) farthest_[level].resize(to.num_places(level));
    float* const nearest = nearest_[level].data();
    float* const farthest = level > 0 ? farthest_[level].data() : nearest;
    to.nearest[level] = nearest;
    to.farthest[level] = farthest;
    const int per_block = level == 0 ? 1 : 4;
    for (int row = 0; row < per_block * to.blocks_high[level]; ++row) {
      for (int column = 0; column < per_block * to.blocks_wide[level]; ++column) {
        if (level == 0) {
          take_depths(to, field.levels[0], column, row, nearest);
        } else {
          merge_depths(to, level, column, row, nearest, farthest);
        }
      }
    }
  }
  stamp_ = field.stamp;
  if (is_blocked) return;  // searched with others only
  windows_.resize(to.windows.num_places());
  squares_.resize(2 * static_cast<std::size_t>(to.windows.wide[0] * to.windows.high[0]));
  to.windows.nearest = windows_.data();
  const auto for_rows = [](std::int32_t wide, std::int32_t high, float* out, const auto& value) {
    for (std::int32_t row = 0; row < high; ++row) {
      for (std::int32_t column = 0; column < wide; ++column) *out++ = value(column, row);
    }
  };
  make_windows(
      to, squares_.data(), windows_.data(),
      [&](float* squares) {
        for_rows(to.windows.wide[0], to.windows.high[0], squares,
                 [&](int column, int row) { return to.nearest[1][to.place(1, column, row)]; });
      },
      [&](const WindowMerge& part, const float* from, float* merged) {
        for_rows(part.merged_wide(), part.merged_high(), merged,
                 [&](int column, int row) { return part.least(from, column, row); });
      });
}

}}  // namespace palpate::v0
