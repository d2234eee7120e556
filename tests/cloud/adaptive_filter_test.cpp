// The adaptive filter against closed forms: what is a plane or a quadratic stays to the last
// digits, noise goes where nothing else is, steps and small shapes stay, and the noise that it
// learns is the one that was put in.
#include <algorithm>
#include <array>
#include <cmath>
#include <cstring>
#include <functional>
#include <string>
#include <vector>

#include <gtest/gtest.h>

#include "palpate/cloud/surface_estimator.h"
#include "src/cloud/surface/adaptive/scale_noise.h"
#include "src/cloud/surface/adaptive/scale_rules.h"
#include "tests/cloud/depth_scenes.h"

namespace palpate {
namespace {

using test::DepthScene;
using test::Random;

SurfaceOptions adaptive() {
  SurfaceOptions options;
  options.filter.smoothing = Smoothing::adaptive;
  return options;
}

std::vector<float> smoothed(const DepthScene& scene, SurfaceOptions options = adaptive(),
                            int num_threads = 1, Isa isa = best_isa()) {
  SurfaceEstimator estimator =
      SurfaceEstimator::create(scene.width, scene.height, scene.intrinsics, options, isa).value();
  ThreadPool pool(num_threads);
  estimator.update(scene.depth, pool);
  return {estimator.depth().begin(), estimator.depth().end()};
}

/// A scene by depth over pixels.
DepthScene scene_of(int width, int height, const std::function<double(double, double)>& depth) {
  DepthScene scene = test::empty_scene(width, height, 525);
  for (int v = 0; v < height; ++v) {
    for (int u = 0; u < width; ++u) scene.at(u, v) = static_cast<float>(depth(u, v));
  }
  return scene;
}

/// Adds noise of a standard deviation, smooth over `radius` pixels each way.
DepthScene with_noise(DepthScene scene, double sd, int radius, std::uint64_t seed) {
  Random random(seed);
  const int w = scene.width + 2 * radius, h = scene.height + 2 * radius;
  std::vector<double> white(static_cast<std::size_t>(w * h));
  for (double& x : white) x = random.normal();
  for (int v = 0; v < scene.height; ++v) {
    for (int u = 0; u < scene.width; ++u) {
      double sum = 0, squares = 0;
      for (int dv = -radius; dv <= radius; ++dv) {
        for (int du = -radius; du <= radius; ++du) {
          const double share = std::exp(-(du * du + dv * dv) / (0.5 * (radius * radius + 0.1)));
          sum += share * white[static_cast<std::size_t>((v + radius + dv) * w + u + radius + du)];
          squares += share * share;
        }
      }
      scene.at(u, v) += static_cast<float>(sd * sum / std::sqrt(squares));
    }
  }
  return scene;
}

double rms_error(const std::vector<float>& depth, const DepthScene& truth, int margin = 0) {
  double sum = 0;
  int num = 0;
  for (int v = margin; v < truth.height - margin; ++v) {
    for (int u = margin; u < truth.width - margin; ++u) {
      const auto i = static_cast<std::size_t>(v * truth.width + u);
      const double error = static_cast<double>(depth[i]) - static_cast<double>(truth.depth[i]);
      sum += error * error;
      ++num;
    }
  }
  return std::sqrt(sum / num);
}

TEST(ScaleRules, HalvesOfAQuadraticAreItsMeansOverThem) {
  // Means of a + b x + c x^2 over cells of width 1 around -2 ... 2, and over the middle one's
  // halves.
  const auto mean = [](double from, double to) {
    const auto integral = [](double x) { return 5 * x + 0.7 * x * x / 2 - 0.3 * x * x * x / 3; };
    return static_cast<float>((integral(to) - integral(from)) / (to - from));
  };
  const auto cell = [&](int i) { return mean(i - 0.5, i + 0.5); };
  const auto halves = one_lane::halves_of(cell(-2), cell(-1), cell(0), cell(1), cell(2));
  EXPECT_NEAR(halves.lower, mean(-0.5, 0), 1e-6);
  EXPECT_NEAR(halves.upper, mean(0, 0.5), 1e-6);
  EXPECT_EQ(one_lane::halves_of(0, cell(-1), cell(0), cell(1), cell(2)).lower, 0);
  EXPECT_EQ(one_lane::halves_of(0, cell(-1), cell(0), cell(1), cell(2)).upper, halves.upper);
  EXPECT_EQ(one_lane::halves_of(cell(-2), 0, cell(0), cell(1), cell(2)).upper, 0);
}

TEST(ScaleRules, CellsOfAPlaneAreExactWhereOneIsMissing) {
  const float a = 1.00f, b = 1.01f, c = 1.02f, d = 1.03f;  // a plane's inverse depths
  const float center = 1.015f;
  EXPECT_NEAR(one_lane::joined_cells(a, b, c, d, 0.05f), center, 1e-6);
  EXPECT_NEAR(one_lane::joined_cells(0, b, c, d, 0.05f), center, 1e-6);
  EXPECT_NEAR(one_lane::joined_cells(a, 0, c, d, 0.05f), center, 1e-6);
  EXPECT_NEAR(one_lane::joined_cells(a, b, 0, d, 0.05f), center, 1e-6);
  EXPECT_NEAR(one_lane::joined_cells(a, b, c, 0, 0.05f), center, 1e-6);
  EXPECT_EQ(one_lane::joined_cells(a, b, 0, 0, 0.05f), 0);
  EXPECT_EQ(one_lane::joined_cells(a, a, 2, 2, 0.05f), 0) << "two surfaces";
}

TEST(ScaleNoise, IsTheOneOfTheDetails) {
  Random random(5);
  std::array<DetailCounts, kNumScales> counts{};
  for (int i = 0; i < 400'000; ++i) {
    const double z = 0.4 + 2.6 * random.uniform();
    const double sd = 0.0004 + 0.0016 * z * z;
    for (int level = 0; level < kNumScales; ++level) {
      const double w = 1 / z, d = sd * std::ldexp(1.0, -level) * random.normal() * w * w;
      counts[static_cast<std::size_t>(level)].add(static_cast<float>(w), static_cast<float>(d));
    }
  }
  const auto noise = noise_of(counts);
  for (int level = 0; level < kNumScales; ++level) {
    for (const double z : {0.5, 1.0, 2.0, 2.8}) {
      const double expected = (0.0004 + 0.0016 * z * z) * std::ldexp(1.0, -level);
      EXPECT_NEAR(noise[static_cast<std::size_t>(level)].at(z), expected, 0.12 * expected)
          << "level " << level << ", " << z << " m";
    }
  }
}

TEST(ScaleNoise, OfLevelsWithoutDetailsIsThatOfTheFinerOne) {
  std::array<DetailCounts, kNumScales> counts{};
  for (int i = 0; i < 1000; ++i) counts[0].add(1.0f, 0.002f);
  const auto noise = noise_of(counts);
  EXPECT_GT(noise[0].at(1), 0.001);
  for (const ScaleNoise& other : noise) EXPECT_EQ(other.at(1), noise[0].at(1));
  for (const ScaleNoise& none : noise_of({})) EXPECT_EQ(none.at(1), 0);
}

TEST(AdaptiveFilter, WhatHasNoNoiseStaysAsItIs) {
  const auto bowl = [](double u, double v) {
    const double x = (u - 80) / 160, y = (v - 60) / 120;  // a quadratic of inverse depth
    return 1 / (1.2 + 0.3 * x - 0.2 * y + 0.25 * x * x - 0.15 * x * y + 0.2 * y * y);
  };
  for (const DepthScene& scene : {test::plane_scene(163, 121, 525, {0.5, -0.3, -0.8}, {0, 0, 0.9}),
                                  scene_of(160, 120, bowl)}) {
    EXPECT_LT(rms_error(smoothed(scene), scene), 1e-6);
  }
}

/// A ball before a wall, in whole millimeters: its limb is steep, and predictions across it are far
/// off.
TEST(AdaptiveFilter, SilhouettesStayWhereTheyAre) {
  const auto ball = scene_of(320, 240, [](double u, double v) {
    const double x = (u - 159.5) / 262, y = (v - 119.5) / 262, a = x * x + y * y + 1;
    const double d = 1.4 * 1.4 - a * (1.4 * 1.4 - 0.32 * 0.32);
    return std::round(1000 * (d > 0 ? (1.4 - std::sqrt(d)) / a : 2.0)) / 1000;
  });
  const std::vector<float> depth = smoothed(ball);
  for (std::size_t i = 0; i < depth.size(); ++i) ASSERT_NEAR(depth[i], ball.depth[i], 0.001) << i;
}

TEST(AdaptiveFilter, PlanesLoseNoiseOfAnyCorrelation) {
  const DepthScene plane = test::plane_scene(320, 240, 525, {0.4, 0.2, -0.9}, {0, 0, 0.7});
  for (const int radius : {0, 2, 3}) {
    const DepthScene noisy = with_noise(plane, 0.001, radius, 7);
    SurfaceOptions bilateral;
    bilateral.filter.smoothing = Smoothing::bilateral;
    const double before = rms_error(smoothed(noisy, bilateral), plane, 20);
    const double after = rms_error(smoothed(noisy), plane, 20);
    EXPECT_LT(after, 0.45 * before) << "smooth over " << radius << " pixels";
    EXPECT_LT(after, radius == 0 ? 0.0001 : 0.0005);
  }
}

/// Waves of 20 mm over the whole image: their details are as frequent as those of noise.
TEST(AdaptiveFilter, ShapeThatFillsTheImageIsNotNoise) {
  for (const int width : {160, 320, 640}) {
    const double period = 23.0 * width / 160;
    const auto waves = scene_of(width, width * 3 / 4, [&](double u, double) {
      return 1.2 + 0.02 * std::sin(2 * 3.14159265358979 * u / period);
    });
    const DepthScene noisy = with_noise(waves, 0.0024, 0, 11);
    SurfaceOptions bilateral;
    bilateral.filter.smoothing = Smoothing::bilateral;
    const double error = rms_error(smoothed(noisy), waves, 8);
    EXPECT_LT(error, rms_error(smoothed(noisy, bilateral), waves, 8)) << width;
    EXPECT_LT(error, 0.001) << width;
  }
}

TEST(AdaptiveFilter, StepsKeepTheirHeightAndSmallBallsTheirs) {
  const auto step = scene_of(320, 240, [](double u, double) { return u < 160 ? 0.6 : 0.595; });
  const std::vector<float> after = smoothed(with_noise(step, 0.001, 2, 3));
  double left = 0, right = 0;
  for (int v = 40; v < 200; ++v) {
    left += static_cast<double>(after[static_cast<std::size_t>(v * 320 + 157)]) / 160;
    right += static_cast<double>(after[static_cast<std::size_t>(v * 320 + 162)]) / 160;
  }
  EXPECT_NEAR(left - right, 0.005, 0.0005);

  // A ball of 30 mm, 8 mm out of a wall at 0.6 m.
  const double c = 0.6 - 0.008 + 0.015;
  const auto ball = scene_of(320, 240, [&](double u, double v) {
    const double x = (u - 159.5) / 525, y = (v - 119.5) / 525, a = x * x + y * y + 1;
    const double d = c * c - a * (c * c - 0.015 * 0.015);
    return d > 0 ? std::min(0.6, (c - std::sqrt(d)) / a) : 0.6;
  });
  double height = 0;
  constexpr int kDraws = 8;
  for (int i = 0; i < kDraws; ++i) {
    const std::vector<float> depth =
        smoothed(with_noise(ball, 0.001, 2, static_cast<std::uint64_t>(i)));
    for (const int at : {119 * 320 + 159, 119 * 320 + 160, 120 * 320 + 159, 120 * 320 + 160}) {
      height += (0.6 - static_cast<double>(depth[static_cast<std::size_t>(at)])) / (4 * kDraws);
    }
  }
  EXPECT_NEAR(height, 0.008, 0.0008);
}

TEST(AdaptiveFilter, FillsNothingAndLeavesFarSpaceFree) {
  DepthScene scene = test::cluttered_scene(133, 99, 300, 1.5, 4);
  for (int u = 0; u < 133; ++u) scene.at(u, 3) = 20;  // beyond max_depth
  SurfaceOptions none;
  none.filter.enabled = false;
  for (const double gap : {0.0, 0.02}) {
    SurfaceOptions options = adaptive();
    options.flying_pixel_gap = none.flying_pixel_gap = gap;
    const std::vector<float> raw = smoothed(scene, none), depth = smoothed(scene, options);
    for (std::size_t i = 0; i < raw.size(); ++i) {
      EXPECT_EQ(std::isnan(depth[i]), std::isnan(raw[i])) << i;
      EXPECT_EQ(std::isinf(depth[i]), std::isinf(raw[i])) << i;
      if (std::isfinite(raw[i])) {
        EXPECT_NEAR(depth[i], raw[i], 0.05 * raw[i]) << i;
      }
    }
  }
}

// Vectors reach beyond rows of any length, and what they leave there must not be seen later.
TEST(AdaptiveFilter, RemembersNothingOfEarlierImages) {
  for (int width = 8; width <= 80; ++width) {
    const int height = 8 + 37 * width % 48;
    SCOPED_TRACE(std::to_string(width) + " x " + std::to_string(height));
    const DepthScene first = with_noise(
        scene_of(width, height, [&](double u, double) { return u > 0.7 * width ? 0.8 : 1; }), 0.002,
        0, 1);
    const DepthScene second =
        with_noise(scene_of(width, height, [](double, double) { return 1; }), 0.002, 0, 2);
    const std::vector<float> expected = smoothed(second, adaptive(), 1, Isa::baseline);
    for (const Isa isa : {Isa::baseline, Isa::avx2, Isa::avx512}) {
      SurfaceEstimator estimator =
          SurfaceEstimator::create(width, height, first.intrinsics, adaptive(), isa).value();
      ThreadPool pool(1);
      for (int i = 0; i < 3; ++i) estimator.update(first.depth, pool);
      estimator.update(second.depth, pool);
      EXPECT_EQ(
          std::memcmp(expected.data(), estimator.depth().data(), expected.size() * sizeof(float)),
          0)
          << isa_name(isa);
    }
  }
}

TEST(AdaptiveFilter, GivesTheSameBitsForAnyThreadsInstructionsAndWindow) {
  for (const auto& [width, height] : {std::pair{131, 77}, std::pair{8, 8}, std::pair{640, 330}}) {
    const DepthScene scene = test::cluttered_scene(width, height, 300, 1.5, 9);
    const std::vector<float> one = smoothed(scene, adaptive(), 1, Isa::baseline);
    const auto is_same = [&](const std::vector<float>& other) {
      return std::memcmp(one.data(), other.data(), one.size() * sizeof(float)) == 0;
    };
    for (const Isa isa : {Isa::baseline, Isa::avx2, Isa::avx512}) {
      for (const int num_threads : {1, 3}) {
        EXPECT_TRUE(is_same(smoothed(scene, adaptive(), num_threads, isa)))
            << width << " x " << height;
      }
    }
    SurfaceEstimator estimator =
        SurfaceEstimator::create(width, height, scene.intrinsics, adaptive()).value();
    ThreadPool pool(2);
    // One after another, with another scene between them.
    const DepthScene other = test::cluttered_scene(width, height, 300, 1.1, 4);
    for (const PixelWindow& window :
         {PixelWindow{width / 3, height / 4, width / 2 + 2, height / 2 + 2},
          PixelWindow{0, 0, 1, 1}, PixelWindow{width - 3, height / 2, width, height},
          PixelWindow{5, 5, 5, 5}, PixelWindow{width / 2, 1, width / 2 + 9, height - 1}}) {
      estimator.update(other.depth, pool, {{width / 4, 0, width, height / 2}, false});
      estimator.update(scene.depth, pool, {window, false});
      int num_other = 0;
      for (int v = window.top; v < window.bottom; ++v) {
        for (int u = window.left; u < window.right; ++u) {
          const auto i = static_cast<std::size_t>(v * width + u);
          num_other += std::memcmp(&one[i], &estimator.depth()[i], sizeof(float)) != 0;
        }
      }
      EXPECT_EQ(num_other, 0) << width << " x " << height << " from " << window.left;
    }
  }
}

}  // namespace
}  // namespace palpate
