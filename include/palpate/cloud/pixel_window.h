// A rectangle of pixels.
#pragma once

#include <algorithm>

namespace palpate {

/// Columns [left, right) and rows [top, bottom); by default those of every image.
struct PixelWindow {
  static constexpr int kEverything = 1 << 20;

  int left = 0, top = 0, right = kEverything, bottom = kEverything;

  int width() const { return right - left; }
  int height() const { return bottom - top; }
  bool is_empty() const { return left >= right || top >= bottom; }
  /// Of an image of this size.
  bool has_all(int image_width, int image_height) const {
    return left <= 0 && top <= 0 && right >= image_width && bottom >= image_height;
  }
  bool contains(const PixelWindow& other) const {
    return left <= other.left && top <= other.top && right >= other.right && bottom >= other.bottom;
  }
  PixelWindow grown(int margin) const {
    return {left - margin, top - margin, right + margin, bottom + margin};
  }
  PixelWindow clipped(int image_width, int image_height) const {
    return {std::max(left, 0), std::max(top, 0), std::min(right, image_width),
            std::min(bottom, image_height)};
  }
  /// Around both.
  PixelWindow joined(const PixelWindow& other) const {
    return {std::min(left, other.left), std::min(top, other.top), std::max(right, other.right),
            std::max(bottom, other.bottom)};
  }
  /// From multiples of `step` to multiples of `step`, not negative.
  PixelWindow aligned(int step) const {
    const auto down = [step](int at) { return std::max(at, 0) / step * step; };
    return {down(left), down(top), down(right + step - 1), down(bottom + step - 1)};
  }
  friend bool operator==(const PixelWindow&, const PixelWindow&) = default;
};

}  // namespace palpate
