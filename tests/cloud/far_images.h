// Depth images with groups of pixels that are too far, and which of them are errors: by brute
// force.
#pragma once

#include <cmath>
#include <cstddef>
#include <limits>
#include <vector>

#include "tests/cloud/depth_scenes.h"
#include "tests/test_util/random.h"

namespace palpate::test {

/// Two slanted surfaces side by side with holes and far groups of all kinds: lone pixels, blobs,
/// diagonal strips, rings and half of the image; meters.
inline DepthScene far_scene(int width, int height, std::uint64_t seed) {
  Random random(seed);
  DepthScene scene = plane_scene(width, height, 90, {0.2 * random.normal(), 0.1, -1}, {0, 0, 1.1});
  const auto number = [&](int end) { return static_cast<int>(random.uniform() * end); };
  const auto draw = [&](double z, const auto& covers) {
    for (int v = 0; v < height; ++v) {
      for (int u = 0; u < width; ++u) {
        if (covers(u, v)) scene.at(u, v) = static_cast<float>(z);
      }
    }
  };
  const int step = number(width);
  for (int v = 0; v < height; ++v) {
    for (int u = step; u < width; ++u) scene.at(u, v) *= 1.6f;
  }
  const double far[] = {10.01, 30, 500, std::numeric_limits<double>::infinity()};
  for (int k = 0; k < 24; ++k) {
    const int u0 = number(width), v0 = number(height), size = 1 + number(k % 4 == 0 ? 24 : 5);
    const bool is_hole = k % 5 == 0;
    const double z = is_hole ? (k % 2 == 0 ? 0.0 : std::nan("")) : far[number(4)];
    draw(z, [&](int u, int v) {
      const int du = u - u0, dv = v - v0;
      switch (k % 3) {
        case 0: return std::abs(du) < size && std::abs(dv) < size;        // a block
        case 1: return du == dv && std::abs(du) < 9 * size;               // a diagonal
        default: return std::abs(std::hypot(du, dv) - 3.0 * size) < 0.6;  // a ring
      }
    });
  }
  for (int k = 0; k < width * height / 40; ++k) {
    scene.at(number(width), number(height)) = static_cast<float>(far[number(4)]);
  }
  if (seed % 3 == 0) draw(far[3], [&](int u, int v) { return v < height / 4 + u / 9; });
  return scene;
}

/// Tells for each pixel: is its ray free up to max_depth? From the definition, group by group.
inline std::vector<bool> free_by_brute_force(const DepthScene& scene, double max_depth) {
  const int w = scene.width, h = scene.height;
  const auto z = [&](int u, int v) {
    return static_cast<double>(scene.depth[static_cast<std::size_t>(v * w + u)]);
  };
  std::vector<bool> free(scene.depth.size()), known(scene.depth.size());
  for (int start = 0; start < w * h; ++start) {
    if (known[static_cast<std::size_t>(start)] || !(z(start % w, start / w) > max_depth)) continue;
    std::vector<int> group{start};
    known[static_cast<std::size_t>(start)] = true;
    int left = w, right = 0, top = h, bottom = 0;
    double nearest = 1e9, farthest = 0;
    for (std::size_t k = 0; k < group.size(); ++k) {
      const int u0 = group[k] % w, v0 = group[k] / w;
      left = std::min(left, u0), right = std::max(right, u0);
      top = std::min(top, v0), bottom = std::max(bottom, v0);
      for (int v = std::max(v0 - 1, 0); v <= std::min(v0 + 1, h - 1); ++v) {
        for (int u = std::max(u0 - 1, 0); u <= std::min(u0 + 1, w - 1); ++u) {
          const auto i = static_cast<std::size_t>(v * w + u);
          if (z(u, v) > max_depth) {
            if (!known[i]) group.push_back(v * w + u);
            known[i] = true;
          } else if (z(u, v) >= 0.1) {
            nearest = std::min(nearest, z(u, v)), farthest = std::max(farthest, z(u, v));
          }
        }
      }
    }
    const int side = 1 + std::max(right - left, bottom - top);
    const bool is_of_two = farthest - nearest > 0.012 * (side + 1) * nearest;
    if (group.size() < 9 || (side <= 32 && !is_of_two)) continue;
    for (const int i : group) free[static_cast<std::size_t>(i)] = true;
  }
  return free;
}

}  // namespace palpate::test
