// Depth frames with all that makes surfaces hard.
#pragma once

#include <algorithm>
#include <cmath>
#include <vector>

#include "palpate/cloud/depth_source.h"
#include "tests/test_util/random.h"

namespace palpate::test {

/// Slanted walls in front of each other, with noise, single holes and wide ones, of which one may
/// be a part that is too far to be a surface.
inline DepthFrame random_frame(int width, int height, Random& random, bool has_far = true) {
  DepthFrame frame{width, height, 0.001, {}, 0};
  frame.pixels.resize(static_cast<std::size_t>(width) * static_cast<std::size_t>(height));
  struct Piece {
    double u, v, radius, depth, by_u, by_v;
  };
  std::vector<Piece> pieces = {{0, 0, 1e9, 1.2, 0.2, -0.1}};
  for (int i = 0; i < 8; ++i) {
    pieces.push_back({random.uniform(0, width), random.uniform(0, height),
                      random.uniform(0.02, 0.25) * width,
                      i == 3 && has_far ? 30
                      : i % 3 == 0      ? 0
                                        : random.uniform(0.4, 1.1),
                      random.uniform(-0.5, 0.5), random.uniform(-0.5, 0.5)});
  }
  for (int v = 0; v < height; ++v) {
    for (int u = 0; u < width; ++u) {
      double z = 0;
      for (const Piece& p : pieces) {
        const double du = u - p.u, dv = v - p.v;
        if (std::abs(du) + std::abs(dv) > p.radius) continue;
        z = p.depth == 0 ? 0 : p.depth + (p.by_u * du + p.by_v * dv) / width;
      }
      z += z > 0 ? 0.002 * random.normal() : 0;
      if (random.uniform() < 0.01) z = 0;
      frame.pixels[static_cast<std::size_t>(v * width + u)] =
          static_cast<std::uint16_t>(std::max(z, 0.0) / frame.unit);
    }
  }
  return frame;
}

}  // namespace palpate::test
