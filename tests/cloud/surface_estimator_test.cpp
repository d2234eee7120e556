// The estimator as a whole: what is invalid, what is refused, same bits everywhere, no allocation.
#include "palpate/cloud/surface_estimator.h"

#include <cstring>
#include <string>

#include <gtest/gtest.h>

#include "tests/cloud/depth_scenes.h"
#include "tests/test_util/allocation_counter.h"

namespace palpate {
namespace {

using test::DepthScene;

SurfaceEstimator make_estimator(const DepthScene& scene, const SurfaceOptions& options = {},
                                Isa isa = best_isa()) {
  return SurfaceEstimator::create(scene.width, scene.height, scene.intrinsics, options, isa)
      .value();
}

// All results of the last update, one array after the other.
std::vector<float> results(const SurfaceEstimator& estimator) {
  const PointCloudView cloud = estimator.cloud();
  std::vector<float> all(estimator.depth().begin(), estimator.depth().end());
  for (const float* channel : {cloud.x, cloud.y, cloud.z, cloud.nx, cloud.ny, cloud.nz}) {
    all.insert(all.end(), channel, channel + cloud.size());
  }
  for (int axis = 0; axis < 3; ++axis) {
    all.insert(all.end(), estimator.depth_change(axis).begin(), estimator.depth_change(axis).end());
  }
  return all;
}

SurfaceOptions with_principal() {
  SurfaceOptions options;
  options.normals.fit = PlaneFit::principal;
  return options;
}

SurfaceOptions with_all_options(PlaneFit fit = PlaneFit::along_ray) {
  SurfaceOptions options;
  options.normals.fit = fit;
  options.normals.anchoring = options.normals.weighting = options.normals.normalization = true;
  options.flying_pixel_gap = 0.01;
  return options;
}

TEST(SurfaceEstimator, WhatIsNoMeasurementIsInvalid) {
  DepthScene scene = test::plane_scene(40, 30, 40, {0, 0, -1}, {0, 0, 1});
  DepthFrame frame = as_frame(scene);
  const auto pixel = [](int u, int v) { return static_cast<std::size_t>(v * 40 + u); };
  const std::pair<std::size_t, std::uint16_t> bad[] = {{pixel(3, 3), 0},
                                                       {pixel(10, 3), 65535},
                                                       {pixel(17, 3), 99},
                                                       {pixel(24, 3), 10001},
                                                       {pixel(31, 3), 65534}};
  const std::pair<std::size_t, std::uint16_t> lone[] = {{pixel(3, 20), 100},
                                                        {pixel(13, 20), 10000}};
  for (const auto& [i, count] : bad) frame.pixels[i] = count;
  for (const auto& [i, count] : lone) frame.pixels[i] = count;
  ThreadPool pool(1);
  SurfaceEstimator estimator = make_estimator(scene);
  const SurfaceStats stats = estimator.update(frame, pool);
  EXPECT_EQ(stats.num_valid, 40 * 30 - 5);
  EXPECT_EQ(stats.num_points, 40 * 30 - 7);
  for (const auto& [i, count] : bad) {
    EXPECT_TRUE(std::isnan(estimator.depth()[i])) << count;
    EXPECT_TRUE(std::isnan(estimator.cloud().x[i])) << count;
    EXPECT_EQ(estimator.depth_change(0)[i], 0.0f);
  }
  for (const auto& [i, count] : lone) {  // at the limits: a depth, but no neighbors
    EXPECT_FLOAT_EQ(estimator.depth()[i], static_cast<float>(count * 0.001)) << count;
    EXPECT_TRUE(std::isnan(estimator.cloud().z[i])) << count;
  }

  const float nan = std::numeric_limits<float>::quiet_NaN();
  const float infinity = std::numeric_limits<float>::infinity();
  for (float value : {nan, infinity, -infinity, 0.0f, -1.0f, 1e30f, 0.0999f, 10.001f}) {
    scene.at(20, 15) = value;
    EXPECT_EQ(estimator.update(scene.depth, pool).num_valid, 40 * 30 - 1) << value;
    EXPECT_TRUE(std::isnan(estimator.depth()[pixel(20, 15)]));
  }
}

TEST(SurfaceEstimator, FrameAndMetersAgree) {
  DepthScene scene = test::cluttered_scene(90, 50, 90, 1.2, 5);
  const DepthFrame frame = as_frame(scene, 0.000125);
  for (std::size_t i = 0; i < scene.depth.size(); ++i) {
    scene.depth[i] = static_cast<float>(frame.pixels[i] * 0.000125);
  }
  ThreadPool pool(1);
  SurfaceEstimator a = make_estimator(scene), b = make_estimator(scene);
  const SurfaceStats from_frame = a.update(frame, pool), from_meters = b.update(scene.depth, pool);
  EXPECT_EQ(from_frame.num_valid, from_meters.num_valid);
  EXPECT_EQ(from_frame.num_points, from_meters.num_points);
  const std::vector<float> of_frame = results(a), of_meters = results(b);
  EXPECT_EQ(std::memcmp(of_frame.data(), of_meters.data(), of_frame.size() * sizeof(float)), 0);
}

TEST(SurfaceEstimator, SameBitsForAnyNumberOfThreads) {
  const DepthScene scene = test::cluttered_scene(203, 151, 200, 1.2, 6);
  for (const SurfaceOptions& options : {SurfaceOptions{}, with_principal(), with_all_options()}) {
    std::vector<float> expected;
    for (int num_threads : {1, 2, 3}) {
      ThreadPool pool(num_threads);
      SurfaceEstimator estimator = make_estimator(scene, options);
      for (int repeat = 0; repeat < 3; ++repeat) {
        const SurfaceStats stats = estimator.update(scene.depth, pool);
        const std::vector<float> found = results(estimator);
        EXPECT_GT(stats.num_points, 20000);
        if (expected.empty()) expected = found;
        EXPECT_EQ(std::memcmp(found.data(), expected.data(), found.size() * sizeof(float)), 0);
      }
    }
  }
}

class SurfaceEstimatorIsa : public testing::TestWithParam<Isa> {};

// The kernels avoid fused and reordered operations, so not even the last bit differs.
TEST_P(SurfaceEstimatorIsa, SameBitsAsBaseline) {
  if (GetParam() > best_isa()) {
    GTEST_SKIP() << "SKIPPED: this processor lacks " << isa_name(GetParam());
  }
  ThreadPool pool(1);
  for (int width : {8, 9, 31, 64, 203}) {
    const DepthScene scene = test::cluttered_scene(width, 45, 100, 1.2, 7);
    for (SurfaceOptions options : {SurfaceOptions{}, with_principal(), with_all_options(),
                                   with_all_options(PlaneFit::principal)}) {
      for (int radius : {2, 3}) {
        options.filter.radius = options.normals.radius = radius;
        SurfaceEstimator baseline = make_estimator(scene, options, Isa::baseline);
        SurfaceEstimator wide = make_estimator(scene, options, GetParam());
        const SurfaceStats a = baseline.update(scene.depth, pool);
        const SurfaceStats b = wide.update(scene.depth, pool);
        EXPECT_EQ(a.num_valid, b.num_valid);
        EXPECT_EQ(a.num_points, b.num_points);
        const std::vector<float> x = results(baseline), y = results(wide);
        EXPECT_EQ(std::memcmp(x.data(), y.data(), x.size() * sizeof(float)), 0) << width;
      }
    }
  }
}

INSTANTIATE_TEST_SUITE_P(All, SurfaceEstimatorIsa, testing::Values(Isa::avx2, Isa::avx512),
                         [](const auto& isa) { return std::string(isa_name(isa.param)); });

TEST(SurfaceEstimator, UpdateAllocatesNothing) {
  const DepthScene scene = test::cluttered_scene(203, 151, 200, 1.2, 8);
  const DepthFrame frame = as_frame(scene);
  ThreadPool pool(2);
  for (const SurfaceOptions& options : {SurfaceOptions{}, with_principal(), with_all_options()}) {
    SurfaceEstimator estimator = make_estimator(scene, options);
    const test::AllocationCounter counter;
    estimator.update(frame, pool);
    estimator.update(scene.depth, pool);
    EXPECT_EQ(counter.count(), 0u);
  }
}

TEST(SurfaceEstimator, AnyImageSize) {
  ThreadPool pool(2);
  for (const auto& [width, height] :
       {std::pair{8, 8}, {9, 8}, {8, 17}, {17, 33}, {4096, 8}, {8, 4096}, {1920, 1080}}) {
    const DepthScene scene = test::plane_scene(width, height, 0.6 * width, {0, 0, -1}, {0, 0, 1});
    SurfaceEstimator estimator = make_estimator(scene);
    const SurfaceStats stats = estimator.update(scene.depth, pool);
    EXPECT_EQ(stats.num_points, width * height);
    const PointCloudView cloud = estimator.cloud();
    EXPECT_EQ(cloud.width, width);
    EXPECT_EQ(cloud.height, height);
    EXPECT_TRUE(cloud.pinhole);
    EXPECT_EQ(cloud.intrinsics, scene.intrinsics);
    const std::size_t padded = (cloud.size() + 63) / 64 * 64;
    for (std::size_t i = 0; i < padded; ++i) {
      ASSERT_EQ(std::isnan(cloud.nz[i]), i >= cloud.size()) << i;
    }
  }
}

TEST(SurfaceEstimator, DisabledDepthChangeIsZero) {
  const DepthScene scene = test::cluttered_scene(61, 47, 60, 1.3, 4);
  SurfaceOptions options;
  options.depth_change.enabled = false;
  SurfaceEstimator estimator = make_estimator(scene, options);
  ThreadPool pool(1);
  estimator.update(scene.depth, pool);
  for (int axis = 0; axis < 3; ++axis) {
    for (float value : estimator.depth_change(axis)) ASSERT_EQ(value, 0.0f);
  }
}

TEST(SurfaceEstimator, MoreNeighborsThanTheWindowHasAreAllOfThem) {
  const DepthScene scene = test::cluttered_scene(61, 47, 60, 1.3, 4);
  ThreadPool pool(1);
  int num_points[3];
  for (int i = 0; i < 3; ++i) {
    SurfaceOptions options;
    options.normals.min_neighbors = std::array{48, 49, 225}[static_cast<std::size_t>(i)];
    num_points[i] = make_estimator(scene, options).update(scene.depth, pool).num_points;
  }
  EXPECT_GT(num_points[0], num_points[1]);
  EXPECT_GT(num_points[1], 0);
  EXPECT_EQ(num_points[1], num_points[2]);
}

TEST(SurfaceEstimator, RefusesSettingsOutOfRangeByName) {
  const Intrinsics good{100, 100, 20, 15};
  const auto error_of = [&](int width, int height, const Intrinsics& k,
                            const SurfaceOptions& options) {
    const auto result = SurfaceEstimator::create(width, height, k, options);
    return result.has_value() ? std::string() : result.error().message;
  };
  const auto expect_refusal = [](const std::string& message, const char* name) {
    EXPECT_NE(message.find(name), std::string::npos) << name << ": " << message;
  };
  EXPECT_EQ(error_of(40, 30, good, {}), "");
  expect_refusal(error_of(7, 30, good, {}), "image width");
  expect_refusal(error_of(4097, 30, good, {}), "image width");
  expect_refusal(error_of(40, -1, good, {}), "image height");
  expect_refusal(error_of(40, 30, {0, 100, 20, 15}, {}), "fx");
  expect_refusal(error_of(40, 30, {100, -5, 20, 15}, {}), "fy");
  expect_refusal(error_of(40, 30, {100, 100, NAN, 15}, {}), "cx");
  expect_refusal(error_of(40, 30, {100, 100, 20, INFINITY}, {}), "cy");

  const auto refuse = [&](const char* name, auto&& change) {
    SurfaceOptions options;
    change(options);
    expect_refusal(error_of(40, 30, good, options), name);
  };
  refuse("surface.filter_radius", [](SurfaceOptions& o) { o.filter.radius = 0; });
  refuse("surface.filter_radius", [](SurfaceOptions& o) { o.filter.radius = 8; });
  refuse("surface.filter_sigma_space", [](SurfaceOptions& o) { o.filter.sigma_space = 0; });
  refuse("surface.filter_sigma_depth", [](SurfaceOptions& o) { o.filter.sigma_depth = NAN; });
  refuse("surface.normal_radius", [](SurfaceOptions& o) { o.normals.radius = 8; });
  refuse("surface.normal_max_depth_change",
         [](SurfaceOptions& o) { o.normals.max_depth_change = -1; });
  refuse("surface.weight_sigma", [](SurfaceOptions& o) { o.normals.weight_sigma = 0; });
  refuse("surface.min_neighbors", [](SurfaceOptions& o) { o.normals.min_neighbors = 226; });
  refuse("surface.min_neighbors", [](SurfaceOptions& o) { o.normals.min_neighbors = 2; });
  refuse("surface.depth_change_min_step",
         [](SurfaceOptions& o) { o.depth_change.min_step = -0.1; });
  refuse("surface.min_depth", [](SurfaceOptions& o) { o.min_depth = 0; });
  refuse("surface.flying_pixel_gap", [](SurfaceOptions& o) { o.flying_pixel_gap = -0.01; });
  refuse("surface.max_depth", [](SurfaceOptions& o) { o.max_depth = 0.05; });
}

}  // namespace
}  // namespace palpate
