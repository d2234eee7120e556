// Depth images of one size, one after the other: walls with a block before them, noise, holes, and
// in every second one a corner and single pixels that are too far.
#pragma once

#include <cmath>
#include <cstdint>
#include <vector>

#include "palpate/field/sensor.h"
#include "tests/test_util/random.h"

namespace palpate::test {

struct RoughImages {
  Camera camera;
  int num;
  std::vector<std::uint16_t> counts;
  std::vector<float> meters;

  RoughImages(int width, int height, int number, std::uint64_t seed)
      : camera{width, height, {0.9 * width, 0.93 * width, 0.49 * width, 0.51 * height}},
        num(number) {
    Random random(seed);
    for (int i = 0; i < num; ++i) {
      const double depth = random.uniform(0.5, 1.5), left = random.uniform(0, 0.6);
      for (int v = 0; v < height; ++v) {
        for (int u = 0; u < width; ++u) {
          const bool is_block = u > left * width && u < (left + 0.3) * width && v > 0.4 * height;
          double z = depth - (is_block ? 0.2 : 0) + 0.002 * random.normal();
          if (random.uniform() < 0.03 || std::hypot(u - 3, v - 0.8 * height) < 0.15 * width) z = 0;
          const bool is_far = i % 2 == 1 && (3 * u + 4 * v < width || random.uniform() < 0.02);
          counts.push_back(is_far ? kFarCount : static_cast<std::uint16_t>(std::lround(1000 * z)));
          meters.push_back(is_far ? INFINITY : static_cast<float>(z));
        }
      }
    }
  }

  std::size_t size() const {
    return static_cast<std::size_t>(camera.width) * static_cast<std::size_t>(camera.height);
  }
  DepthImageView image(int i) const {
    return {camera.width, camera.height, counts.data() + static_cast<std::size_t>(i) * size(),
            0.001};
  }
  DepthImageView image_in_meters(int i) const {
    return {camera.width, camera.height, meters.data() + static_cast<std::size_t>(i) * size()};
  }
};

}  // namespace palpate::test
