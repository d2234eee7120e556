// Frames of real sensors: nearly every measurement gets a normal, and it faces the camera.
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <memory>
#include <string>

#include <gtest/gtest.h>
#include <png.h>

#include "palpate/cloud/surface_estimator.h"
#include "tests/cloud/surface_truth.h"
#include "tests/test_util/data.h"
#include "tests/test_util/real_frames.h"

namespace palpate {
namespace {

// 16-bit gray PNG; an empty frame if it cannot be read.
DepthFrame read_png(const std::filesystem::path& path, double unit) {
  DepthFrame frame;
  const std::unique_ptr<std::FILE, int (*)(std::FILE*)> file(std::fopen(path.c_str(), "rb"),
                                                             std::fclose);
  if (file == nullptr) return frame;
  png_structp png = png_create_read_struct(PNG_LIBPNG_VER_STRING, nullptr, nullptr, nullptr);
  png_infop info = png_create_info_struct(png);
  png_init_io(png, file.get());
  png_read_png(png, info, PNG_TRANSFORM_SWAP_ENDIAN, nullptr);
  frame.width = static_cast<int>(png_get_image_width(png, info));
  frame.height = static_cast<int>(png_get_image_height(png, info));
  frame.unit = unit;
  png_bytepp rows = png_get_rows(png, info);
  for (int v = 0; v < frame.height; ++v) {
    const auto* row = reinterpret_cast<const std::uint16_t*>(rows[v]);
    frame.pixels.insert(frame.pixels.end(), row, row + frame.width);
  }
  png_destroy_read_struct(&png, &info, nullptr);
  return frame;
}

PALPATE_ON_ALL_FRAMES(RealFrames);

TEST_P(RealFrames, NormalsAreThereAreUnitAndFaceTheCamera) {
  PALPATE_FRAMES_OR_SKIP(frames, [](const auto& path) { return read_png(path, 0.001); });
  ThreadPool pool(2);
  for (const test::TriedFrame& real : frames) {
    SCOPED_TRACE(real.name);
    const DepthFrame& frame = real.frame;
    ASSERT_EQ(frame.pixels.size(), 640u * 480u);
    SurfaceEstimator estimator = SurfaceEstimator::create(640, 480, real.intrinsics).value();
    const SurfaceStats stats = estimator.update(frame, pool);
    EXPECT_GT(stats.num_points, 0.8 * stats.num_valid);
    EXPECT_GT(stats.num_valid, 0.6 * 640 * 480);
    const PointCloudView cloud = estimator.cloud();
    const test::TrueDepth depth{estimator.depth(), 640, 480};
    double worst_angle = 0;
    int num_points = 0, num_compared = 0;
    for (std::size_t i = 0; i < cloud.size(); ++i) {
      if (std::isnan(cloud.nx[i])) continue;
      ++num_points;
      const Vec3d p{cloud.x[i], cloud.y[i], cloud.z[i]};
      const Vec3d n{cloud.nx[i], cloud.ny[i], cloud.nz[i]};
      ASSERT_NEAR(norm(n), 1, 1e-6);
      ASSERT_LE(dot(n, p), 1e-6 * norm(p));
      if (i % 23 != 0) continue;
      const test::TrueNormal expected = true_normal(
          depth, real.intrinsics, {}, static_cast<int>(i % 640), static_cast<int>(i / 640));
      ASSERT_TRUE(expected.exists);
      if (!expected.well_conditioned) continue;
      ++num_compared;
      worst_angle = std::max(worst_angle, std::min(test::angle_between(n, expected.n),
                                                   test::angle_between(-n, expected.n)));
    }
    EXPECT_EQ(num_points, stats.num_points);
    EXPECT_GT(num_compared, 3000);
    EXPECT_LE(worst_angle, 0.05);
  }
}

/// Pixels of a recorded frame that are free up to max_depth.
int num_free_of(const std::filesystem::path& path, const Intrinsics& intrinsics) {
  const DepthFrame frame = read_png(path, 0.001);
  EXPECT_EQ(frame.pixels.size(), 640u * 480u) << path;
  if (frame.pixels.empty()) return -1;
  ThreadPool pool(1);
  SurfaceEstimator estimator = SurfaceEstimator::create(640, 480, intrinsics).value();
  estimator.update(frame, pool);
  return static_cast<int>(std::ranges::count(estimator.depth(), INFINITY));
}

TEST(FarPixelsOfRealSensors, AreErrorsInsideADesk) {
  PALPATE_DATA_OR_SKIP(folder, "sequences/visp_rbt/depth");
  for (const char* name : {"000034", "000038", "000042", "000050", "000090"}) {
    EXPECT_EQ(
        num_free_of(folder / (std::string(name) + ".png"), {607.178, 607.234, 321.391, 241.918}), 0)
        << name;
  }
}

TEST(FarPixelsOfRealSensors, AreFreeInAWindow) {
  PALPATE_DATA_OR_SKIP(folder, "recordings/aims-d4xx-lab/depth");
  for (int number = 139; number <= 155; ++number) {
    const int num_free =
        num_free_of(folder / (std::to_string(number) + ".png"), {600, 600, 319.5, 239.5});
    EXPECT_GT(num_free, 4500) << number;
    EXPECT_LT(num_free, 5500) << number;
  }
}

}  // namespace
}  // namespace palpate
