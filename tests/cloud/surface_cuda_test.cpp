// Surface estimation on a GPU against that of the CPU: the same bits.
#include "src/cloud/internal/surface_cuda.h"

#include <algorithm>
#include <cmath>
#include <span>
#include <string>
#include <vector>

#include "src/cloud/internal/frame_noise.h"
#include "tests/cloud/depth_scenes.h"
#include "tests/cloud/far_images.h"
#include "tests/cloud/gpu_copies.h"
#include "tests/test_util/gpu.h"

namespace palpate {
namespace {

using test::DepthScene;

/// Both backends on one scene.
struct Pair {
  SurfaceEstimator cpu;
  SurfaceCuda cuda;
  gpu::Stream stream{0, gpu::Priority::low};
  ThreadPool pool{1};
  SurfaceStats expected{};

  Pair(const DepthScene& scene, const SurfaceOptions& options, const Distortion& bent = {})
      : cpu(SurfaceEstimator::create(scene.width, scene.height, scene.intrinsics, options,
                                     best_isa(), bent)
                .value()),
        cuda(std::move(
            SurfaceCuda::create(scene.width, scene.height, scene.intrinsics, options, 0, 0, bent)
                .value())) {}

  void take(const DepthFrame& frame) {
    std::ranges::copy(frame.pixels, cuda.input().begin());
    cuda.set_unit(frame.unit);
    expected = cpu.update(frame, pool);
  }

  void compare() {
    ASSERT_TRUE(stream.wait()) << stream.status().error().message;
    EXPECT_EQ(cuda.stats().num_valid, expected.num_valid);
    EXPECT_EQ(cuda.stats().num_points, expected.num_points);
    test::expect_same_bits(test::copy_to_host(stream, cuda.cloud().depth, cpu.depth().size()),
                           cpu.depth().data(), "depth");
    test::expect_same_cloud(stream, cuda.cloud(), cpu.cloud());
    const FrameNoise &got = *cuda.cloud().noise, &want = *cpu.cloud().noise;
    EXPECT_TRUE(std::ranges::equal(got.base, want.base));
    EXPECT_TRUE(std::ranges::equal(got.growth, want.growth));
    EXPECT_EQ(got.is_whole, want.is_whole);
  }
};

SurfaceOptions default_options() {
  SurfaceOptions options;
  options.depth_change.min_step = 0.01;
  return options;
}

TEST(SurfaceCuda, ChannelsAreOneArray) {
  PALPATE_GPU_OR_SKIP();
  const Pair pair(test::cluttered_scene(45, 37, 60, 1.5, 1), default_options());
  const PointCloudView cloud = pair.cuda.cloud(), on_cpu = pair.cpu.cloud();
  const std::ptrdiff_t apart = on_cpu.y - on_cpu.x;
  const float* const channels[] = {cloud.x, cloud.y, cloud.z, cloud.nx, cloud.ny, cloud.nz};
  for (std::ptrdiff_t k = 0; k < 6; ++k) EXPECT_EQ(channels[k], cloud.x + k * apart) << k;
}

TEST(SurfaceCuda, EqualsTheCpuWithEveryOption) {
  PALPATE_GPU_OR_SKIP();
  std::uint64_t seed = 0;
  for (int flags = 0; flags < 32; ++flags) {
    for (const int radius : {1, 2, 3, 5, 7}) {
      if (flags % 8 != 0 && radius > 3 && (flags + radius) % 3 != 0) continue;  // to save time
      SurfaceOptions options = default_options();
      options.filter.enabled = (flags & 8) != 0;
      options.filter.smoothing = Smoothing::bilateral;
      options.filter.radius = radius;
      options.normals.fit = flags < 16 ? PlaneFit::along_ray : PlaneFit::principal;
      options.normals.radius = radius;
      options.normals.anchoring = (flags & 1) != 0;
      options.normals.weighting = (flags & 2) != 0;
      options.normals.normalization = (flags & 4) != 0;
      options.flying_pixel_gap = flags % 3 == 0 ? 0.015 : 0;
      SCOPED_TRACE("flags " + std::to_string(flags) + " radius " + std::to_string(radius));
      const DepthScene scene = test::cluttered_scene(45, 37, 60, 1.5, ++seed);
      Pair pair(scene, options);
      pair.take(test::as_frame(scene));
      pair.cuda.enqueue(pair.stream);
      ASSERT_NO_FATAL_FAILURE(pair.compare());
      EXPECT_GT(pair.expected.num_points, 300);
    }
  }
}

struct SizeCase {
  int width, height;
  double distance, unit;
};
constexpr SizeCase kSizes[] = {
    {96, 72, 1.2, 0.001},   {8, 8, 0.8, 0.001},    {33, 17, 0.5, 0.0002},  {64, 32, 4.0, 0.001},
    {31, 49, 2.0, 0.00025}, {129, 16, 1.0, 0.001}, {320, 240, 1.0, 0.0001}};

TEST(SurfaceCuda, EqualsTheCpuForAnySizeUnitAndDistance) {
  PALPATE_GPU_OR_SKIP();
  for (const SizeCase& c : kSizes) {
    SCOPED_TRACE(std::to_string(c.width) + " x " + std::to_string(c.height));
    const DepthScene scene = test::cluttered_scene(c.width, c.height, 1.1 * c.width, c.distance, 5);
    Pair pair(scene, default_options());
    pair.take(test::as_frame(scene, c.unit));
    pair.cuda.enqueue(pair.stream);
    ASSERT_NO_FATAL_FAILURE(pair.compare());
  }
}

TEST(SurfaceCuda, KnowsWhatIsNoMeasurement) {
  PALPATE_GPU_OR_SKIP();
  DepthScene scene = test::plane_scene(40, 24, 50, {0, 0, -1}, {0, 0, 1});
  SurfaceOptions options = default_options();
  options.max_depth = 70;
  Pair pair(scene, options);
  DepthFrame frame = test::as_frame(scene);
  for (std::size_t i = 0; i < frame.pixels.size(); i += 37) {
    frame.pixels[i] = static_cast<std::uint16_t>(i % 2 == 0 ? 65535 : 0);
  }
  frame.pixels[100] = 99;  // nearer than min_depth
  pair.take(frame);
  pair.cuda.enqueue(pair.stream);
  pair.compare();
  EXPECT_LT(pair.expected.num_valid, 40 * 24);
}

TEST(SurfaceCuda, DecidesWhatIsFree) {
  PALPATE_GPU_OR_SKIP();
  int num_free = 0;
  for (std::uint64_t seed = 1; seed <= 12; ++seed) {
    SCOPED_TRACE(seed);
    const DepthScene scene = test::far_scene(60 + 13 * static_cast<int>(seed), 97, seed);
    Pair pair(scene, default_options());
    pair.expected = pair.cpu.update(scene.depth, pair.pool);
    gpu::Memory memory(0);
    const float* const meters = memory.copy_of(scene.depth);
    pair.cuda.enqueue_depth(pair.stream, meters);
    ASSERT_NO_FATAL_FAILURE(pair.compare());
    for (int part = 0; part < 3; ++part) pair.cuda.enqueue_depth(pair.stream, meters, part, 3);
    ASSERT_NO_FATAL_FAILURE(pair.compare());
    num_free += static_cast<int>(std::ranges::count(pair.cpu.depth(), INFINITY));
  }
  EXPECT_GT(num_free, 1000);
}

TEST(SurfaceCuda, StraightensBentImages) {
  PALPATE_GPU_OR_SKIP();
  const DepthScene scene = test::cluttered_scene(99, 75, 90, 1.2, 6);
  SurfaceOptions options = default_options();
  options.flying_pixel_gap = 0.015;
  Pair flat(scene, options);
  flat.take(test::as_frame(scene));
  for (const Distortion& bent : {Distortion{-0.28, 0.09, 0.001, -0.002, -0.01, 0, 0, 0},
                                 Distortion{0.4, 0, 0, 0, 0, 0, 0, 0},
                                 Distortion{5.9, 3.4, 1e-5, 3e-5, 0.17, 6.2, 5.1, 0.9}}) {
    Pair pair(scene, options, bent);
    pair.take(test::as_frame(scene));
    pair.cuda.enqueue(pair.stream);
    ASSERT_NO_FATAL_FAILURE(pair.compare());
    EXPECT_NE(pair.expected.num_points, flat.expected.num_points);
  }
}

TEST(SurfaceCuda, OrderOfThreadsDoesNotMatter) {
  PALPATE_GPU_OR_SKIP();
  const DepthScene scene = test::cluttered_scene(96, 72, 90, 1.2, 8);
  test::in_all_orders([&] {
    Pair pair(scene, default_options());
    pair.take(test::as_frame(scene));
    for (int run = 0; run < 2; ++run) {
      pair.cuda.enqueue(pair.stream);
      ASSERT_NO_FATAL_FAILURE(pair.compare());
    }
  });
}

TEST(SurfaceCuda, PartsGiveTheSameBitsAndReadTheirRowsOnly) {
  PALPATE_GPU_OR_SKIP();
  const DepthScene scene = test::cluttered_scene(70, 150, 90, 1.2, 9);
  SurfaceOptions options = default_options();
  options.filter.smoothing = Smoothing::bilateral;
  options.filter.radius = options.normals.radius = 7;
  const DepthFrame frame = test::as_frame(scene);
  for (const int num_parts : {1, 2, 3, 4, 10, 16}) {
    SCOPED_TRACE(num_parts);
    Pair pair(scene, options);
    pair.expected = pair.cpu.update(frame, pair.pool);
    pair.cuda.set_unit(frame.unit);
    int rows_given = 0;
    for (int part = 0; part < num_parts; ++part) {
      const ImageRows rows = pair.cuda.input_rows(part, num_parts);
      EXPECT_EQ(rows.begin, rows_given);
      const auto begin = frame.pixels.begin();
      std::copy(begin + rows.begin * scene.width, begin + rows.end * scene.width,
                pair.cuda.input().begin() + rows.begin * scene.width);
      rows_given = rows.end;
      pair.cuda.enqueue(pair.stream, part, num_parts);
      ASSERT_TRUE(pair.stream.wait());
    }
    EXPECT_EQ(rows_given, scene.height);
    ASSERT_NO_FATAL_FAILURE(pair.compare());
  }
}

TEST(SurfaceCuda, ARecordingTakesWhateverFrameIsThere) {
  PALPATE_GPU_OR_SKIP();
  const DepthScene scene = test::cluttered_scene(50, 40, 60, 1.2, 1);
  Pair pair(scene, default_options());
  pair.stream.begin_recording();
  pair.cuda.enqueue(pair.stream);
  const gpu::Graph graph = pair.stream.end_recording();
  for (const std::uint64_t seed : {2u, 3u, 4u}) {
    const double unit = seed == 3 ? 0.0005 : 0.001;
    pair.take(test::as_frame(test::cluttered_scene(50, 40, 60, 1.2, seed), unit));
    pair.stream.launch(graph);
    ASSERT_NO_FATAL_FAILURE(pair.compare());
  }
}

TEST(SurfaceCuda, TakesDepthInMeters) {
  PALPATE_GPU_OR_SKIP();
  DepthScene scene = test::cluttered_scene(77, 60, 80, 1.2, 4);
  scene.at(3, 3) = 0;
  scene.at(4, 3) = INFINITY;
  scene.at(5, 3) = -1;
  Pair pair(scene, default_options());
  pair.expected = pair.cpu.update(scene.depth, pair.pool);
  gpu::Memory memory(0);
  pair.cuda.enqueue_depth(pair.stream, memory.copy_of(scene.depth));
  pair.compare();
}

SurfaceOptions adaptive_options() {
  SurfaceOptions options = default_options();
  options.filter.smoothing = Smoothing::adaptive;
  return options;
}

TEST(SurfaceCuda, SmoothsAsTheCpuForAnySize) {
  PALPATE_GPU_OR_SKIP();
  for (const SizeCase& c : kSizes) {
    for (const double flying_gap : {0.0, 0.015}) {
      SCOPED_TRACE(std::to_string(c.width) + " x " + std::to_string(c.height));
      SurfaceOptions options = adaptive_options();
      options.flying_pixel_gap = flying_gap;
      const DepthScene scene =
          test::cluttered_scene(c.width, c.height, 1.1 * c.width, c.distance, 5);
      Pair pair(scene, options);
      pair.take(test::as_frame(scene, c.unit));
      pair.cuda.enqueue(pair.stream);
      ASSERT_NO_FATAL_FAILURE(pair.compare());
    }
  }
}

TEST(SurfaceCuda, SmoothsSurfacesWithAndWithoutNoiseAsTheCpu) {
  PALPATE_GPU_OR_SKIP();
  const DepthScene plane = test::plane_scene(100, 75, 90, {0.3, -0.2, -1}, {0, 0, 0.9});
  const DepthScene empty = test::empty_scene(100, 75, 90);
  DepthScene steps = plane, ball = plane;
  test::Random random(3);
  for (int v = 0; v < plane.height; ++v) {
    for (int u = 0; u < plane.width; ++u) {
      if (u > 37) steps.at(u, v) += u < 70 ? 0.004f : 0.3f;
      steps.at(u, v) += static_cast<float>(0.0005 * random.normal());
      const double rest = 120 - (u - 50) * (u - 50) - (v - 30) * (v - 30);
      if (rest > 0) ball.at(u, v) -= static_cast<float>(0.002 * std::sqrt(rest));
      ball.at(u, v) += static_cast<float>(0.001 * random.normal());
    }
  }
  DepthScene lone = empty;  // fewer details than tell a noise
  lone.at(40, 40) = lone.at(41, 40) = 1.0f;
  Pair pair(plane, adaptive_options());
  gpu::Memory memory(0);
  for (const DepthScene& scene : {plane, empty, steps, ball, lone, plane}) {
    pair.expected = pair.cpu.update(scene.depth, pair.pool);
    pair.cuda.enqueue_depth(pair.stream, memory.copy_of(scene.depth));
    ASSERT_NO_FATAL_FAILURE(pair.compare());
  }
}

TEST(SurfaceCuda, SmoothsWhatIsBesideFreeSpaceAsTheCpu) {
  PALPATE_GPU_OR_SKIP();
  for (std::uint64_t seed = 1; seed <= 4; ++seed) {
    SCOPED_TRACE(seed);
    const DepthScene scene = test::far_scene(60 + 13 * static_cast<int>(seed), 97, seed);
    Pair pair(scene, adaptive_options());
    pair.expected = pair.cpu.update(scene.depth, pair.pool);
    gpu::Memory memory(0);
    const float* const meters = memory.copy_of(scene.depth);
    for (const int num_parts : {1, 3, 10}) {
      for (int part = 0; part < num_parts; ++part) {
        pair.cuda.enqueue_depth(pair.stream, meters, part, num_parts);
      }
      ASSERT_NO_FATAL_FAILURE(pair.compare());
    }
  }
}

TEST(SurfaceCuda, SmoothsBentImagesAsTheCpu) {
  PALPATE_GPU_OR_SKIP();
  const DepthScene scene = test::cluttered_scene(99, 75, 90, 1.2, 6);
  Pair pair(scene, adaptive_options(), {-0.28, 0.09, 0.001, -0.002, -0.01, 0, 0, 0});
  pair.take(test::as_frame(scene));
  pair.cuda.enqueue(pair.stream);
  pair.compare();
}

TEST(SurfaceCuda, SmoothsRecordedFramesInAnyOrderOfThreads) {
  PALPATE_GPU_OR_SKIP();
  test::in_all_orders([] {
    Pair pair(test::cluttered_scene(70, 50, 60, 1.2, 1), adaptive_options());
    pair.stream.begin_recording();
    pair.cuda.enqueue(pair.stream);
    const gpu::Graph graph = pair.stream.end_recording();
    for (const std::uint64_t seed : {2u, 3u}) {
      pair.take(test::as_frame(test::cluttered_scene(70, 50, 60, 1.2, seed)));
      pair.stream.launch(graph);
      ASSERT_NO_FATAL_FAILURE(pair.compare());
    }
  });
}

TEST(SurfaceCuda, SmoothsEachImageOfABatchByItself) {
  PALPATE_GPU_OR_SKIP();
  constexpr int kWidth = 70, kHeight = 45, kImages = 3;
  constexpr auto kPixels = static_cast<std::size_t>(kWidth * kHeight);
  std::vector<float> depth;
  const DepthScene first = test::cluttered_scene(kWidth, kHeight, 60, 1, 0);
  for (int i = 0; i < kImages; ++i) {
    const DepthScene scene =
        test::cluttered_scene(kWidth, kHeight, 60, 1 + 0.5 * i, static_cast<std::uint64_t>(i));
    depth.insert(depth.end(), scene.depth.begin(), scene.depth.end());
  }
  SurfaceOptions options = adaptive_options();
  options.depth_change.enabled = false;
  SurfaceCuda cuda = std::move(
      SurfaceCuda::create(kWidth, kHeight, first.intrinsics, options, 0, kImages).value());
  gpu::Stream stream{0, gpu::Priority::low};
  gpu::Memory memory(0);
  cuda.enqueue_images(stream, nullptr, memory.copy_of(depth), kImages);
  ASSERT_TRUE(stream.wait());
  SurfaceEstimator cpu =
      SurfaceEstimator::create(kWidth, kHeight, first.intrinsics, options).value();
  ThreadPool pool(1);
  for (std::size_t i = 0; i < kImages; ++i) {
    SCOPED_TRACE(i);
    cpu.update(std::span(depth).subspan(i * kPixels, kPixels), pool);
    const float* const image =
        cuda.cloud().depth + static_cast<std::ptrdiff_t>(i) * cuda.points_apart();
    test::expect_same_bits(test::copy_to_host(stream, image, kPixels), cpu.depth().data(), "depth");
  }
}

TEST(SurfaceCuda, WithoutDepthChangeVectorsAreZero) {
  PALPATE_GPU_OR_SKIP();
  const DepthScene scene = test::cluttered_scene(40, 30, 60, 1.2, 4);
  SurfaceOptions options = default_options();
  options.depth_change.enabled = false;
  Pair pair(scene, options);
  pair.take(test::as_frame(scene));
  pair.cuda.enqueue(pair.stream);
  pair.compare();
  for (const float x : test::copy_to_host(pair.stream, pair.cuda.cloud().edge_x, 40 * 30)) {
    EXPECT_EQ(x, 0);
  }
}

TEST(SurfaceCuda, RefusesBadSettings) {
  PALPATE_GPU_OR_SKIP();
  EXPECT_FALSE(SurfaceCuda::create(7, 100, {60, 60, 4, 50}, {}, 0));
  SurfaceOptions options;
  options.normals.radius = 8;
  EXPECT_FALSE(SurfaceCuda::create(64, 48, {60, 60, 32, 24}, options, 0));
}

}  // namespace
}  // namespace palpate
