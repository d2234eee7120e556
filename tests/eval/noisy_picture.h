// Depth images made up for tests.
#pragma once

#include <cmath>
#include <functional>

#include "palpate/cloud/depth_source.h"
#include "src/math/internal/random.h"

namespace palpate::eval {

/// Renders `depth` (m along z, of each ray (x / z, y / z, 1)) with noise of 1 mm.
inline DepthFrame noisy_picture(
    const DepthStreamInfo& stream,
    const std::function<double(int u, int v, const Vec3d& ray)>& depth) {
  DepthFrame frame{stream.width, stream.height, stream.unit, {}, 0};
  Random random(3);
  const Intrinsics& k = stream.intrinsics;
  for (int v = 0; v < stream.height; ++v) {
    for (int u = 0; u < stream.width; ++u) {
      const double z =
          depth(u, v, {(u - k.cx) / k.fx, (v - k.cy) / k.fy, 1}) + 0.001 * random.normal();
      frame.pixels.push_back(static_cast<std::uint16_t>(std::lround(z / stream.unit)));
    }
  }
  return frame;
}

/// A stream of images in steps of 0.1 mm, the optical axis in the middle.
inline DepthStreamInfo made_up_camera(int width, int height, double focal_length) {
  DepthStreamInfo stream;
  stream.width = width, stream.height = height, stream.unit = 1e-4;
  stream.intrinsics = {focal_length, focal_length, width / 2.0, height / 2.0};
  return stream;
}

}  // namespace palpate::eval
