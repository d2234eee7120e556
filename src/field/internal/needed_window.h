// The window of the image that a tool needs of a depth field.
#pragma once

#include <algorithm>
#include <cmath>

#include "src/field/internal/field_sample.h"

namespace palpate { inline namespace v0 {

/// Returns the pixels that show the points at most `reach` (m) from p_C. A window at the border of
/// the image includes all beyond. For a ball that is not in front of the camera it is the whole
/// image, as for one so far away that numbers overflow.
inline PixelWindow needed_window(const Intrinsics& k, int width, int height, const Vec3d& p_C,
                                 double reach) {
  if (!(p_C.z - reach > static_cast<double>(kMinDepth))) return {0, 0, width, height};
  // The ball's outline in the plane of one axis and z: where rays from the eye touch a circle.
  const auto find = [&](double x, double focal, double center, int size, int& first, int& last) {
    const double z = p_C.z, across = reach * std::sqrt(x * x + z * z - reach * reach);
    const double scale = focal / (z * z - reach * reach);
    const double low = std::floor(scale * (x * z - across) + center);
    const double high = std::ceil(scale * (x * z + across) + center);
    first = low > 0 ? static_cast<int>(std::min<double>(low, size - 1)) : 0;
    last = high < size ? static_cast<int>(std::max<double>(high, 1)) : size;
  };
  PixelWindow window;
  find(p_C.x, k.fx, k.cx, width, window.left, window.right);
  find(p_C.y, k.fy, k.cy, height, window.top, window.bottom);
  return window;
}

/// True if the field has all pixels that are read at points within `reach` (m) of p_C.
inline bool is_known_around(const DepthFieldView& field, const Vec3d& p_C, double reach) {
  const int width = field.levels[0].width, height = field.levels[0].height;
  return field.requested.has_all(width, height) ||
         field.requested.contains(needed_window(field.intrinsics, width, height, p_C, reach));
}

}}  // namespace palpate::v0
