// The window of pixels that the tool projects to.
#pragma once

#include <algorithm>
#include <cmath>

#include <span>

#include "palpate/cloud/point_cloud.h"
#include "palpate/math/geometry.h"
#include "palpate/mesh/mesh.h"

namespace palpate { inline namespace v0 {

/// Half-open ranges of rows and columns.
struct ImageWindow {
  int row_begin = 0, row_end = 0, column_begin = 0, column_end = 0;
};

/// The box around some spheres.
Bounds bounds_of(std::span<const Sphere> spheres);

/// Returns the image of a box given in the tool frame, one pixel larger on every side; the whole
/// cloud if there is none (no pinhole cloud, box at or behind the camera).
ImageWindow image_window(const PointCloudView& cloud, const Bounds& box_T, const Pose& X_WT);

/// Largest distance of a point of the tool, or of the mean of edge points around one, from the
/// tool's origin, m.
inline double reach_of_sums(const Bounds& box_T) {
  Vec3d far;
  for (int axis = 0; axis < 3; ++axis) {
    far[axis] = std::max(std::abs(box_T.low[axis]), std::abs(box_T.high[axis]));
  }
  return 2 * norm(far);
}

}}  // namespace palpate::v0
