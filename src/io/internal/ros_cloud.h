// Point clouds as ROS sends them.
#pragma once

#include <string_view>

#include "palpate/core/core.h"
#include "src/cloud/internal/cloud_camera.h"

namespace palpate { inline namespace v0 {

/// Reads sensor_msgs/PointCloud2: x, y, z, and normal_x, normal_y, normal_z where it has all three,
/// wherever they lie in a point, of any number type, in either byte order; `scale`: meters per
/// number. Nothing is allocated before all sizes are checked against the message; the memory of
/// `points` is used again. Errors: damaged, no points, more than kMaxCloudPoints, a coordinate that
/// is missing, there twice, or outside of its point.
Status read_point_cloud(std::string_view message, double scale, CloudPoints& points);

}}  // namespace palpate::v0
