// Depth images made on the spot.
#pragma once

#include <cmath>
#include <vector>

#include "palpate/cloud/depth_source.h"
#include "tests/test_util/random.h"

namespace palpate::test {

struct DepthScene {
  int width, height;
  Intrinsics intrinsics;
  std::vector<float> depth;  ///< meters, NaN: no measurement

  float& at(int u, int v) { return depth[static_cast<std::size_t>(v * width + u)]; }
};

inline DepthScene empty_scene(int width, int height, double f) {
  return {width,
          height,
          {f, f, width / 2.0 - 0.5, height / 2.0 - 0.5},
          std::vector<float>(static_cast<std::size_t>(width * height), NAN)};
}

/// The plane n.p = n.p0 as the camera sees it.
inline DepthScene plane_scene(int width, int height, double f, const Vec3d& n, const Vec3d& p0) {
  DepthScene scene = empty_scene(width, height, f);
  const Intrinsics& k = scene.intrinsics;
  for (int v = 0; v < height; ++v) {
    for (int u = 0; u < width; ++u) {
      const Vec3d ray{(u - k.cx) / k.fx, (v - k.cy) / k.fy, 1};
      scene.at(u, v) = static_cast<float>(dot(n, p0) / dot(n, ray));
    }
  }
  return scene;
}

/// A bit of everything at a given distance: a slanted bumpy wall, a ball and a pillar before it,
/// noise growing with z^2, lost pixels, holes, single rows and lone pixels in the holes.
inline DepthScene cluttered_scene(int width, int height, double f, double distance,
                                  std::uint64_t seed) {
  DepthScene scene = empty_scene(width, height, f);
  Random random(seed);
  for (int v = 0; v < height; ++v) {
    for (int u = 0; u < width; ++u) {
      const double s = (u - width / 2.0) / width, t = (v - height / 2.0) / height;
      double z = distance * (1 + 0.4 * s + 0.2 * t + 0.01 * std::sin(20 * s) * std::cos(15 * t));
      const double d = (s + 0.2) * (s + 0.2) + t * t;
      if (d < 0.03) z = distance * (0.8 - std::sqrt(0.03 - d));
      if (s > 0.2 && s < 0.27) z = distance * (0.5 + 0.1 * t);
      z += 0.0015 * z * z * random.normal();
      const bool hole = (u / 12 + v / 12) % 7 == 0;
      const bool left_in_hole = v % 12 == 5 || (u % 12 == 6 && v % 12 == 9);
      if (random.uniform() < 0.02 || (hole && !left_in_hole)) continue;
      scene.at(u, v) = static_cast<float>(z);
    }
  }
  return scene;
}

/// The same as a sensor would send it.
inline DepthFrame as_frame(const DepthScene& scene, double unit = 0.001) {
  DepthFrame frame;
  frame.width = scene.width;
  frame.height = scene.height;
  frame.unit = unit;
  for (float z : scene.depth) {
    frame.pixels.push_back(
        std::isfinite(z) ? static_cast<std::uint16_t>(std::lround(static_cast<double>(z) / unit))
                         : std::uint16_t{0});
  }
  return frame;
}

}  // namespace palpate::test
