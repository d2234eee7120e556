// Any cloud seen from the origin as an organized pinhole cloud, which a depth field is made from.
#pragma once

#include "palpate/cloud/point_cloud.h"
#include "palpate/core/core.h"

namespace palpate { inline namespace v0 {

/// A pinhole cloud is copied. An organized one whose points lie on the rays of some pinhole camera
/// (to a quarter of a pixel) gets the intrinsics of that camera. The points of any other cloud are
/// put into an image of about as many pixels as there are points, 8 to 2048 a side; the nearest
/// one of a pixel stays. O(points). Error: no valid point in front of the camera (z > 0).
Result<PointCloud> make_pinhole_cloud(const PointCloudView& cloud);

}}  // namespace palpate::v0
