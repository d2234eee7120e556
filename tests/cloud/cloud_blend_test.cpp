#include "src/cloud/internal/cloud_blend.h"

#include <cmath>
#include <cstring>

#include <gtest/gtest.h>

#include "tests/test_util/allocation_counter.h"
#include "tests/test_util/random.h"

namespace palpate {
namespace {

constexpr int kWidth = 32, kHeight = 24;
constexpr std::size_t kSize = kWidth * kHeight;
constexpr double kMaxJump = 0.03;
const Intrinsics kCamera{40, 41, 15.2, 11.7};

/// The plane at `distance` from the eye, exact on every ray.
PointCloud plane_cloud(const Vec3d& normal, double distance) {
  PointCloud cloud(kWidth, kHeight, kCamera);
  for (int v = 0; v < kHeight; ++v) {
    for (int u = 0; u < kWidth; ++u) {
      const Vec3d ray{(u - kCamera.cx) / kCamera.fx, (v - kCamera.cy) / kCamera.fy, 1};
      const Vec3d p = ray * (-distance / dot(normal, ray));
      cloud.set(static_cast<std::size_t>(v * kWidth + u), to_float(p), to_float(normal));
    }
  }
  return cloud;
}

PointCloud blend(const PointCloud& from, const PointCloud& to, double t, int num_threads = 1) {
  ThreadPool pool(num_threads);
  PointCloud out(kWidth, kHeight, kCamera);
  blend_clouds(from.view(), to.view(), t, kMaxJump, pool, out);
  return out;
}

void expect_same(const PointCloud& got, const PointCloud& expected, double tolerance) {
  for (std::size_t i = 0; i < kSize; ++i) {
    EXPECT_NEAR(norm(to_double(got.point(i)) - to_double(expected.point(i))), 0, tolerance) << i;
    EXPECT_NEAR(norm(to_double(got.normal(i)) - to_double(expected.normal(i))), 0, tolerance) << i;
  }
}

TEST(FrameProgress, IsClamped) {
  EXPECT_EQ(frame_progress(1.0, 1.0, 0.04), 0);
  EXPECT_DOUBLE_EQ(frame_progress(1.01, 1.0, 0.04), 0.25);
  EXPECT_EQ(frame_progress(1.5, 1.0, 0.04), 1);
  EXPECT_EQ(frame_progress(0.9, 1.0, 0.04), 0);
}

// A wall of any slant at constant speed: between two frames it is where it was between them, and
// beyond the last one it is where it will be.
TEST(BlendClouds, FollowsAPlaneAtConstantSpeed) {
  const Vec3d normal = normalized(Vec3d{0.2, -0.3, -0.9});
  const double distance = 0.8, step = -0.006;
  const PointCloud from = plane_cloud(normal, distance);
  const PointCloud to = plane_cloud(normal, distance + step);
  for (const double t : {0.0, 0.1, 0.5, 0.9, 1.0, 2.0}) {
    expect_same(blend(from, to, t), plane_cloud(normal, distance + t * step), 1e-6);
  }
}

TEST(BlendClouds, TurnsNormals) {
  const Vec3d a = normalized(Vec3d{0.05, 0, -1}), b = normalized(Vec3d{-0.05, 0.02, -1});
  const PointCloud mixed = blend(plane_cloud(a, 0.8), plane_cloud(b, 0.8), 0.25);
  const std::size_t middle = 12 * kWidth + 15;
  EXPECT_NEAR(norm(to_double(mixed.normal(middle)) - normalized(a * 0.75 + b * 0.25)), 0, 1e-6);
}

// Thesis Fig. 3.16: a point that is missing in one frame must not draw the surface towards the eye.
TEST(BlendClouds, DoesNotMixWithMissingOrDistantPoints) {
  PointCloud from = plane_cloud({0, 0, -1}, 0.8), to = plane_cloud({0, 0, -1}, 0.79);
  from.set(40, {NAN, 0, 0}, {0, 0, -1});          // appears
  to.set(41, {NAN, 0, 0}, {0, 0, -1});            // vanishes
  to.set(42, from.point(42) * 0.9f, {0, 0, -1});  // another surface, nearer
  to.set(43, from.point(43) * 1.1f, {0, 0, -1});  // farther
  from.set(44, from.point(44), {0, 0, 1});        // opposite normals have no mean
  const PointCloud mixed = blend(from, to, 0.5);
  for (const std::size_t i : {40u, 42u, 43u, 44u}) {
    EXPECT_EQ(mixed.point(i).z, to.point(i).z) << i;
    EXPECT_EQ(mixed.normal(i).z, to.normal(i).z) << i;
  }
  for (int channel = 0; channel < 6; ++channel) EXPECT_TRUE(std::isnan(mixed.channel(channel)[41]));
  for (const std::size_t i : {39u, 45u}) EXPECT_NEAR(mixed.point(i).z, 0.795f, 1e-6) << i;
}

TEST(BlendClouds, SameBitsForAnyNumberOfThreadsAndNoAllocation) {
  const PointCloud from = plane_cloud({0, 0, -1}, 0.8), to = plane_cloud({0, 0, -1}, 0.79);
  const PointCloud one = blend(from, to, 0.3, 1), five = blend(from, to, 0.3, 5);
  for (int channel = 0; channel < 6; ++channel) {
    EXPECT_EQ(std::memcmp(one.channel(channel), five.channel(channel), kSize * sizeof(float)), 0);
  }
  ThreadPool pool(2);
  PointCloud out(kWidth, kHeight, kCamera);
  const test::AllocationCounter counter;
  blend_clouds(from.view(), to.view(), 0.3, kMaxJump, pool, out);
  EXPECT_EQ(counter.count(), 0u);
}

}  // namespace
}  // namespace palpate
