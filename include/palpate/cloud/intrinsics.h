// The pinhole model of a depth camera. Camera frame C: x right, y down, z forward.
#pragma once

namespace palpate {

/// Pixels. x = (u - cx) z / fx, y = (v - cy) z / fy, pixel centres at whole numbers.
struct Intrinsics {
  double fx = 0, fy = 0, cx = 0, cy = 0;

  friend bool operator==(const Intrinsics&, const Intrinsics&) = default;
};

/// How a lens bends the image, in the order of OpenCV and ROS: Brown-Conrady ("plumb_bob": k1, k2,
/// p1, p2, k3) or rational (k4 to k6 as well). A point x = X / Z, y = Y / Z, r^2 = x^2 + y^2 is
/// seen at x' = x (1 + k1 r^2 + k2 r^4 + k3 r^6) / (1 + k4 r^2 + k5 r^4 + k6 r^6) + 2 p1 x y + p2
/// (r^2 + 2 x^2), y' likewise, and pixel fx x' + cx, fy y' + cy. All 0: a pinhole.
struct Distortion {
  double k1 = 0, k2 = 0, p1 = 0, p2 = 0, k3 = 0, k4 = 0, k5 = 0, k6 = 0;

  friend bool operator==(const Distortion&, const Distortion&) = default;
};

}  // namespace palpate
