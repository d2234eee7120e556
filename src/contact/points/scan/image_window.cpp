#include "src/contact/points/scan/image_window.h"

#include <algorithm>
#include <cmath>

namespace palpate { inline namespace v0 {

Bounds bounds_of(std::span<const Sphere> spheres) {
  Bounds box{{1e300, 1e300, 1e300}, {-1e300, -1e300, -1e300}};
  for (const Sphere& s : spheres) {
    for (int axis = 0; axis < 3; ++axis) {
      box.low[axis] = std::min(box.low[axis], static_cast<double>(s.center[axis]) - s.radius);
      box.high[axis] = std::max(box.high[axis], static_cast<double>(s.center[axis]) + s.radius);
    }
  }
  return box;
}

ImageWindow image_window(const PointCloudView& cloud, const Bounds& box_T, const Pose& X_WT) {
  const ImageWindow everything{0, cloud.height, 0, cloud.width};
  if (!cloud.pinhole) return everything;
  // A box lies inside the convex hull of its corners, and so does its image.
  double u_low = 1e300, u_high = -1e300, v_low = 1e300, v_high = -1e300;
  const Mat3d R_WT = rotation_matrix(X_WT.rotation);
  for (int corner = 0; corner < 8; ++corner) {
    const Vec3d p_T{(corner & 1) ? box_T.high.x : box_T.low.x,
                    (corner & 2) ? box_T.high.y : box_T.low.y,
                    (corner & 4) ? box_T.high.z : box_T.low.z};
    const Vec3d p_W = R_WT * p_T + X_WT.translation;
    if (!(p_W.z > 1e-6)) return everything;
    const double u = cloud.intrinsics.fx * p_W.x / p_W.z + cloud.intrinsics.cx;
    const double v = cloud.intrinsics.fy * p_W.y / p_W.z + cloud.intrinsics.cy;
    u_low = std::min(u_low, u), u_high = std::max(u_high, u);
    v_low = std::min(v_low, v), v_high = std::max(v_high, v);
  }
  const auto clamped = [](double value, int limit) {
    return static_cast<int>(std::clamp(value, 0.0, static_cast<double>(limit)));
  };
  return {clamped(std::floor(v_low) - 1, cloud.height),
          clamped(std::ceil(v_high) + 2, cloud.height), clamped(std::floor(u_low) - 1, cloud.width),
          clamped(std::ceil(u_high) + 2, cloud.width)};
}

}}  // namespace palpate::v0
