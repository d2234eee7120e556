// Which pixels can hold a point of the tool.
#pragma once

#include <span>

#include "palpate/cloud/point_cloud.h"
#include "palpate/math/pose.h"
#include "palpate/math/sphere.h"
#include "palpate/mesh/triangle_mesh.h"

namespace palpate {

/// Half-open ranges of rows and columns.
struct ImageWindow {
  int row_begin = 0, row_end = 0, column_begin = 0, column_end = 0;
};

/// The box around some spheres.
Bounds bounds_of(std::span<const Sphere> spheres);

/// The image of a box given in the tool frame, one pixel larger on every side; the whole cloud
/// where that cannot be said (no pinhole cloud, box at or behind the camera).
ImageWindow image_window(const PointCloudView& cloud, const Bounds& box_T, const Pose& X_WT);

}  // namespace palpate
