// The simulated sensor, which works in rows, against its definition for each pixel by itself.
#include "scenes/noise_model.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <limits>

#include <gtest/gtest.h>

namespace palpate::scenes {
namespace {

constexpr int kWidth = 97, kHeight = 23;
constexpr double kNone = std::numeric_limits<double>::quiet_NaN();
const Intrinsics kCamera{90, 91, 48, 11};

std::uint64_t mixed(std::uint64_t z) {
  z = (z ^ (z >> 30)) * 0xbf58476d1ce4e5b9u;
  z = (z ^ (z >> 27)) * 0x94d049bb133111ebu;
  return z ^ (z >> 31);
}

/// Makes steps, a slope, holes, what is too near and too far for counts, and what is behind the
/// camera.
std::vector<float> depth_image() {
  std::vector<float> depth;
  for (int v = 0; v < kHeight; ++v) {
    for (int u = 0; u < kWidth; ++u) {
      double z = 0.5 + 0.001 * u + 0.3 * ((u / 9 + v / 4) % 3);
      if ((7 * u + 13 * v) % 41 == 0) z = kNone;
      if (v == 3) z = 0.00004 * u;
      if (v == 5) z = 60 + 0.2 * u;
      if (v == 8) z = -1;
      depth.push_back(static_cast<float>(z));
    }
  }
  return depth;
}

/// Returns the normal number of a pixel: heads among n coins and a uniform number.
double normal(std::uint64_t coins, int n, double smoothing) {
  return (std::popcount(coins) - 0.5 * n + smoothing - 0.5) / std::sqrt(n / 4.0 + 1.0 / 12.0);
}

/// Returns what the definition says: depth after missing pixels, jitter at edges, the projector's
/// shadow, noise, and rounded disparity.
double measured(const NoiseModel& model, const std::vector<float>& depth, std::uint64_t seed,
                std::uint64_t frame, int u, int v) {
  constexpr std::uint64_t kGolden = 0x9e3779b97f4a7c15u;
  const auto at = [&](int column, int row) {
    return static_cast<double>(depth[static_cast<std::size_t>(row * kWidth + column)]);
  };
  const std::uint64_t key = mixed(mixed(seed + kGolden) + (frame + 1) * kGolden);
  const auto draw = [&](std::uint64_t which) {
    return mixed(key + (static_cast<std::uint64_t>(v * kWidth + u) * 3 + which + 1) * kGolden);
  };
  const auto uniform = [](std::uint64_t bits) {
    return (static_cast<double>(bits & 0xffffffffu) + 0.5) * 0x1.0p-32;
  };
  if (uniform(draw(1)) < model.missing) return kNone;
  int column = u, row = v;
  if (model.lateral > 0) {
    const auto shifted = [&](int from, std::uint64_t coins, int size) {
      const double by = std::floor(model.lateral * normal(coins & 0xffffffffu, 32, 0.5) + 0.5);
      return std::clamp(from + static_cast<int>(by), 0, size - 1);
    };
    const int other_u = shifted(u, draw(2), kWidth), other_v = shifted(v, draw(2) >> 32, kHeight);
    if (!(std::abs(at(other_u, other_v) - at(u, v)) <= 0.03 * at(u, v))) {
      column = other_u, row = other_v;
    }
  }
  const double z = at(column, row), disparity = kCamera.fx * model.baseline;
  if (!(z > 0)) return kNone;
  for (int right = column + 1; disparity > 0 && right < kWidth; ++right) {
    const double before = at(right, row);
    if (before > 0 && right - disparity / before <= column - disparity / z) return kNone;
  }
  const double sigma = model.axial_base + model.axial_growth * (z - 0.4) * (z - 0.4);
  const double noise = normal(draw(0), 64, uniform(draw(1) >> 32));
  const double steps = disparity * model.disparity_steps;
  if (!(steps > 0)) return z + sigma * noise;
  const double step = z * z / steps;
  const double noisy = z + std::sqrt(std::max(0.0, sigma * sigma - step * step / 12)) * noise;
  return noisy > 0 ? steps / std::max(1.0, std::floor(steps / noisy + 0.5)) : kNone;
}

TEST(DepthSensor, EqualsItsDefinitionForEveryPixel) {
  const std::vector<float> depth = depth_image();
  std::vector<std::uint16_t> counts(depth.size());
  for (const NoiseModel& model :
       {NoiseModel{}, NoiseModel{.disparity_steps = 0}, NoiseModel{.baseline = 0},
        NoiseModel{.lateral = 0}, NoiseModel{.missing = 0.3, .lateral = 3.7},
        NoiseModel{.axial_base = 0.5}, NoiseModel{.axial_base = 0, .axial_growth = 0}}) {
    for (const double unit : {0.001, 0.0001}) {
      DepthSensor sensor(model, kCamera, kWidth, kHeight, unit, 7);
      int num_moved = 0;
      for (const std::uint64_t frame : {0u, 5u}) {
        sensor.measure(depth, frame, counts);
        for (int v = 0; v < kHeight; ++v) {
          for (int u = 0; u < kWidth; ++u) {
            const double count = std::floor(measured(model, depth, 7, frame, u, v) / unit + 0.5);
            const int want = count >= 1 && count < 65535 ? static_cast<int>(count) : 0;
            const double plain =
                static_cast<double>(depth[static_cast<std::size_t>(v * kWidth + u)]);
            num_moved += want != 0 && std::abs(want - plain / unit) > 1;
            ASSERT_EQ(counts[static_cast<std::size_t>(v * kWidth + u)], want) << u << ' ' << v;
          }
        }
      }
      EXPECT_GT(num_moved, 2 * kWidth);
    }
  }
}

TEST(DepthSensor, WithoutNoiseOnlyRounds) {
  const std::vector<float> depth = depth_image();
  std::vector<std::uint16_t> counts(depth.size());
  DepthSensor({.enabled = false}, kCamera, kWidth, kHeight, 0.001, 7).measure(depth, 0, counts);
  for (std::size_t i = 0; i < depth.size(); ++i) {
    const double count = std::floor(static_cast<double>(depth[i]) / 0.001 + 0.5);
    EXPECT_EQ(counts[i], count >= 1 && count < 65535 ? count : 0);
  }
}

}  // namespace
}  // namespace palpate::scenes
