// Pixels that were measured as farther than max_depth: which of them are free, against brute force.
#include "src/cloud/frames/far_pixels.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <string>
#include <vector>

#include <gtest/gtest.h>

#include "palpate/cloud/surface_estimator.h"
#include "tests/cloud/depth_scenes.h"
#include "tests/cloud/far_images.h"
#include "tests/test_util/allocation_counter.h"

namespace palpate {
namespace {

using test::DepthScene;

constexpr float kInfinite = std::numeric_limits<float>::infinity();

SurfaceEstimator estimator_of(const DepthScene& scene, Isa isa = best_isa()) {
  return SurfaceEstimator::create(scene.width, scene.height, scene.intrinsics, {}, isa).value();
}

std::vector<bool> free_of(const SurfaceEstimator& estimator) {
  std::vector<bool> free;
  for (const float z : estimator.depth()) free.push_back(z == kInfinite);
  return free;
}

/// A wall at 1 m with groups in it, whose pixels are listed.
struct Wall {
  DepthScene scene = test::plane_scene(120, 100, 90, {0, 0, -1}, {0, 0, 1});

  void block(int u0, int v0, int width, int height, float z = 30) {
    for (int v = v0; v < v0 + height; ++v) {
      for (int u = u0; u < u0 + width; ++u) scene.at(u, v) = z;
    }
  }
  /// The answer for the whole image.
  int num_free() const {
    ThreadPool pool(1);
    SurfaceEstimator estimator = estimator_of(scene);
    estimator.update(scene.depth, pool);
    const std::vector<bool> free = free_of(estimator);
    return static_cast<int>(std::ranges::count(free, true));
  }
};

TEST(FarPixels, EqualBruteForce) {
  ThreadPool pool(2);
  int num_free = 0, num_errors = 0;
  for (std::uint64_t seed = 1; seed <= 60; ++seed) {
    const int width = 60 + static_cast<int>(seed * 7 % 90),
              height = 50 + static_cast<int>(seed % 61);
    const DepthScene scene = test::far_scene(width, height, seed);
    const std::vector<bool> expected = test::free_by_brute_force(scene, 10);
    for (const Isa isa : {Isa::baseline, Isa::avx2, Isa::avx512}) {
      SurfaceEstimator estimator = estimator_of(scene, isa);
      estimator.update(scene.depth, pool);
      ASSERT_EQ(free_of(estimator), expected) << seed;
      for (std::size_t i = 0; i < expected.size(); ++i) {
        if (scene.depth[i] > 10) {
          ASSERT_TRUE(std::isnan(estimator.cloud().z[i]));
        }
      }
    }
    num_free += static_cast<int>(std::ranges::count(expected, true));
    num_errors +=
        static_cast<int>(std::ranges::count_if(scene.depth, [](float z) { return z > 10; }));
  }
  num_errors -= num_free;
  EXPECT_GT(num_free, 10000);
  EXPECT_GT(num_errors, 10000);
}

TEST(FarPixels, WindowsShowWhatTheWholeImageShows) {
  ThreadPool pool(2);
  for (std::uint64_t seed = 1; seed <= 20; ++seed) {
    const DepthScene scene = test::far_scene(170, 150, seed);
    const std::vector<bool> expected = test::free_by_brute_force(scene, 10);
    SurfaceEstimator estimator = estimator_of(scene);
    test::Random random(seed);
    for (int k = 0; k < 8; ++k) {
      const auto number = [&](int end) { return static_cast<int>(random.uniform() * end); };
      const int left = number(150), top = number(130);
      const PixelWindow window{left, top, left + 1 + number(60), top + 1 + number(60)};
      estimator.update(scene.depth, pool, {window, false});
      const std::vector<bool> free = free_of(estimator);
      const PixelWindow seen = window.clipped(170, 150);
      for (int v = seen.top; v < seen.bottom; ++v) {
        for (int u = seen.left; u < seen.right; ++u) {
          const auto i = static_cast<std::size_t>(v * 170 + u);
          ASSERT_EQ(free[i], expected[i]) << seed << " at " << u << " " << v;
        }
      }
      if (k % 2 == 1) continue;
      estimator.complete(pool);
      ASSERT_EQ(free_of(estimator), expected) << seed;
    }
  }
}

TEST(FarPixels, NineOfTwoSurfacesAreFree) {
  // Beside a step of 0.6 m, where they lie inside no surface.
  for (const auto& [width, height, num] : {std::tuple{2, 4, 0}, {3, 3, 9}, {9, 1, 9}, {8, 1, 0}}) {
    Wall wall;
    wall.block(50, 0, 70, 100, 1.6f);
    wall.block(48, 40, width, height);
    wall.block(49 + width, 40, 1, height, 1.6f);
    EXPECT_EQ(wall.num_free(), num) << width << " x " << height;
  }
}

// Three pixels wide, from the pixel before to the one behind there are four steps of 1.2 %.
TEST(FarPixels, OneSurfaceIsAsSteepAsThatOfAField) {
  for (const auto& [behind, num] : {std::pair{1.047f, 0}, {1.05f, 9}}) {
    Wall wall;
    wall.block(50, 0, 70, 100, behind);
    wall.block(48, 40, 3, 3);
    EXPECT_EQ(wall.num_free(), num) << behind;
  }
}

TEST(FarPixels, InsideOneSurfaceTheyAreErrorsUpToASize) {
  for (const auto& [width, height, num] : {std::tuple{3, 3, 0},
                                           {16, 16, 0},
                                           {32, 32, 0},
                                           {33, 1, 33},
                                           {33, 33, 33 * 33},
                                           {2, 33, 66}}) {
    Wall wall;
    wall.block(20, 20, width, height);
    EXPECT_EQ(wall.num_free(), num) << width << " x " << height;
  }
  // Nor do holes around them say that they are far.
  Wall wall;
  wall.block(10, 10, 60, 60, 0);
  wall.block(20, 20, 30, 30);
  EXPECT_EQ(wall.num_free(), 0);
}

TEST(FarPixels, UpdatesAllocateNothing) {
  ThreadPool pool(1);
  const DepthScene scene = test::far_scene(150, 110, 3);
  SurfaceEstimator estimator = estimator_of(scene);
  estimator.update(scene.depth, pool);
  const test::AllocationCounter counter;
  estimator.update(scene.depth, pool);
  EXPECT_EQ(counter.count(), 0u);
}

// Checkered images have the most runs there can be.
TEST(FarPixels, AnyPatternFits) {
  ThreadPool pool(1);
  DepthScene scene = test::plane_scene(131, 97, 90, {0, 0, -1}, {0, 0, 1});
  for (const int step : {1, 2}) {
    for (int v = 0; v < scene.height; ++v) {
      for (int u = 0; u < scene.width; ++u) {
        const bool is_far = step == 1 ? (u + v) % 2 == 0 : u % 2 == 0 && v % 2 == 0;
        scene.at(u, v) = is_far ? kInfinite : 1;
      }
    }
    SurfaceEstimator estimator = estimator_of(scene);
    estimator.update(scene.depth, pool);
    EXPECT_EQ(free_of(estimator), test::free_by_brute_force(scene, 10));
  }
}

}  // namespace
}  // namespace palpate
