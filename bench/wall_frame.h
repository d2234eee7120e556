// Setup of every surface benchmark: a depth image of a flat wall at 1 m with 1.5 mm noise.
#pragma once

#include <cmath>
#include <numbers>
#include <vector>

#include "palpate/cloud/depth_source.h"
#include "palpate/math/geometry.h"
#include "tests/test_util/random.h"

namespace palpate::bench {

struct WallFrame {
  int width, height;
  Intrinsics intrinsics;
  std::vector<float> depth;  // meters

  WallFrame(int image_width, int image_height) : width(image_width), height(image_height) {
    const double f = 525.0 * width / 640;
    intrinsics = {f, f, (width - 1) / 2.0, (height - 1) / 2.0};
    test::Random random(1);
    for (int i = 0; i < width * height; ++i) {
      depth.push_back(static_cast<float>(1.0 + 0.0015 * random.normal()));
    }
  }

  DepthImageView image() const { return {width, height, depth.data()}; }

  /// The hard case: a pillar every 40 columns, and a hole of 6 by 6 pixels in every 32 by 32.
  void add_edges_and_holes() {
    for (int v = 0; v < height; ++v) {
      for (int u = 0; u < width; ++u) {
        float& z = depth[static_cast<std::size_t>(v) * static_cast<std::size_t>(width) +
                         static_cast<std::size_t>(u)];
        if (u % 40 < 12) z -= 0.3f;
        if (u % 32 < 6 && v % 32 < 6) z = 0;
      }
    }
  }
};

/// Mean angle between normals and the wall's normal, (0, 0, -1).
class MeanAngle {
 public:
  void add(const Vec3d& n) {
    const double angle = std::atan2(std::hypot(n.x, n.y), -n.z);
    if (!std::isfinite(angle)) return;
    sum_ += angle;
    ++num_;
  }
  double degrees() const { return sum_ / num_ * 180 / std::numbers::pi; }
  int num() const { return num_; }

 private:
  double sum_ = 0;
  int num_ = 0;
};

}  // namespace palpate::bench
