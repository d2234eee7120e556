// The pinhole model of a depth camera. Camera frame C: x right, y down, z forward.
#pragma once

namespace palpate {

/// Pixels. x = (u - cx) z / fx, y = (v - cy) z / fy, pixel centres at whole numbers.
struct Intrinsics {
  double fx = 0, fy = 0, cx = 0, cy = 0;

  friend bool operator==(const Intrinsics&, const Intrinsics&) = default;
};

}  // namespace palpate
