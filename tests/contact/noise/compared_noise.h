// Standard deviations of one place beside those of another.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>

#include <gtest/gtest.h>

#include "src/cloud/internal/frame_noise.h"
#include "tests/contact/noise/noise_study.h"

namespace palpate::test {

/// Documented accuracy of a GPU, relative to the deviations of a vector.
inline constexpr double kGpuNoise = 1e-4;

inline void expect_near(const std::array<double, 7>& got, const std::array<double, 7>& want,
                        double tolerance = kGpuNoise) {
  const auto size_of = [&](std::size_t first) {
    return std::sqrt(want[first] * want[first] + want[first + 1] * want[first + 1] +
                     want[first + 2] * want[first + 2]);
  };
  EXPECT_NEAR(got[0], want[0], tolerance * want[0]);
  for (std::size_t k = 1; k < 7; ++k) {
    EXPECT_NEAR(got[k], want[k], tolerance * size_of(k < 4 ? 1 : 4)) << k;
  }
}

/// Kinds of noise: white, of wider scales, growing with the square of the depth.
inline std::array<FrameNoise, 4> kinds_of_noise() {
  return {frame_noise({.at_zero = 0.001}), frame_noise({.at_zero = 0.0005, .length = 5}),
          frame_noise({.growth = 0.003}),
          frame_noise({.at_zero = 0.0002, .growth = 0.001, .length = 12})};
}

}  // namespace palpate::test
