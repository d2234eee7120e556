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

/// A pixel around which raw depth is flat 20 pixels each way, and the normal of the plane there.
struct FlatPlace {
  int u, v;
  Vec3d normal;
};
std::vector<FlatPlace> flat_places(const DepthFrame& frame, const Intrinsics& k) {
  constexpr int kReach = 20;
  std::vector<FlatPlace> places;
  for (int v = 40; v < frame.height - 40; v += 24) {
    for (int u = 40; u < frame.width - 40; u += 24) {
      // The plane of inverse depth w = a + b du + c dv: on a symmetric window without holes its
      // coefficients are plain sums.
      double w = 0, wu = 0, wv = 0, ww = 0;
      bool has_all = true;
      for (int dv = -kReach; dv <= kReach && has_all; ++dv) {
        for (int du = -kReach; du <= kReach; ++du) {
          const double z =
              frame.unit * frame.pixels[static_cast<std::size_t>((v + dv) * frame.width + u + du)];
          has_all = has_all && z > 0.4 && z < 2.5;
          w += 1 / z;
          wu += du / z;
          wv += dv / z;
          ww += 1 / (z * z);
        }
      }
      if (!has_all) continue;
      const double num = (2 * kReach + 1.0) * (2 * kReach + 1.0);
      const double spread = num * kReach * (kReach + 1) / 3.0;
      const double a = w / num, b = wu / spread, c = wv / spread;
      const double residual = ww / num - a * a - (b * b + c * c) * spread / num;
      if (std::sqrt(std::max(residual, 0.0)) > 0.003 * std::max(a, 1.0)) continue;
      const double x = b * k.fx, y = c * k.fy;
      const Vec3d n{x, y, a - x * (u - k.cx) / k.fx - y * (v - k.cy) / k.fy};
      places.push_back({u, v, (-1 / std::sqrt(dot(n, n))) * n});
    }
  }
  return places;
}

TEST(FlatPlacesOfRealFrames, AreFlatWithAdaptiveSmoothing) {
  const std::vector<test::TriedFrame> frames = test::frames_of(
      test::Origin::recorded, [](const auto& path) { return read_png(path, 0.001); });
  if (frames.empty()) GTEST_SKIP() << "SKIPPED: no recorded depth frames (set PALPATE_DATA)";
  ThreadPool pool(2);
  double angles[2] = {};
  int num = 0;
  for (const test::TriedFrame& real : frames) {
    const std::vector<FlatPlace> places = flat_places(real.frame, real.intrinsics);
    for (const Smoothing smoothing : {Smoothing::bilateral, Smoothing::adaptive}) {
      SurfaceOptions options;
      options.filter.smoothing = smoothing;
      SurfaceEstimator estimator =
          SurfaceEstimator::create(640, 480, real.intrinsics, options).value();
      estimator.update(real.frame, pool);
      const PointCloudView cloud = estimator.cloud();
      for (const FlatPlace& place : places) {
        for (int dv = -6; dv <= 6; ++dv) {
          for (int du = -6; du <= 6; ++du) {
            const auto i = static_cast<std::size_t>((place.v + dv) * 640 + place.u + du);
            const Vec3d n{cloud.nx[i], cloud.ny[i], cloud.nz[i]};
            angles[smoothing == Smoothing::adaptive] +=
                std::acos(std::min(1.0, dot(n, place.normal)));
          }
        }
      }
    }
    num += static_cast<int>(places.size());
  }
  ASSERT_GT(num, 1000);
  EXPECT_LT(angles[1], 0.4 * angles[0]);  // 2.4 against 7.7 degrees in the mean
}

}  // namespace
}  // namespace palpate
