// Clouds of a small camera, made by a formula, and the depth field of one.
#pragma once

#include <cmath>
#include <cstdint>
#include <utility>

#include "palpate/field/depth_field.h"
#include "palpate/math/geometry.h"
#include "tests/test_util/random.h"

namespace palpate::test::field_clouds {

inline constexpr int kWidth = 161, kHeight = 120;
inline const Intrinsics kCamera{150, 152, 79.3, 61.1};

/// A cloud whose pixel (u, v) has depth `depth(u, v)` and normal `normal(u, v)`; NaN leaves a hole.
template <class Depth, class Normal>
PointCloud make_cloud(const Depth& depth, const Normal& normal, int width = kWidth,
                      int height = kHeight) {
  PointCloud cloud(width, height, kCamera);
  for (int v = 0; v < height; ++v) {
    for (int u = 0; u < width; ++u) {
      const double z = depth(u, v);
      const Vec3d p{(u - kCamera.cx) * z / kCamera.fx, (v - kCamera.cy) * z / kCamera.fy, z};
      cloud.set(static_cast<std::size_t>(v * width + u), to_float(p), to_float(normal(u, v)));
    }
  }
  return cloud;
}

/// A bumpy wall with a step, noise, and holes of all sizes.
inline PointCloud rough_cloud(std::uint64_t seed, int width = kWidth, int height = kHeight) {
  test::Random random(seed);
  return make_cloud(
      [&](int u, int v) -> double {
        if (random.uniform() < 0.02 || (u - 40) * (u - 40) + (v - 80) * (v - 80) < 200) return NAN;
        const double wall = u > 90 && v > 40 ? 0.6 : 0.85;
        return wall + 0.01 * std::sin(u * 0.1) + 0.002 * random.normal();
      },
      [&](int, int) {
        return Vec3d{0, 0, -1} + 0.2 * random.direction();
      },
      width, height);
}

inline DepthField make_field(const PointCloud& cloud, const DepthFieldOptions& options = {},
                             Isa isa = best_isa()) {
  ThreadPool pool(1);
  DepthField field =
      std::move(DepthField::create(cloud.width(), cloud.height(), options, isa)).value();
  field.update(cloud.view(), pool);
  return field;
}

}  // namespace palpate::test::field_clouds
