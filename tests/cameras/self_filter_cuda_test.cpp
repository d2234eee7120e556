// The self filter on a GPU: the bits of the one on a CPU, and right by rays and distances in
// double.
#include "src/cameras/robot/link_image_cuda.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <string>

#include "src/cameras/internal/link_image.h"
#include "tests/cameras/robot_scene.h"
#include "tests/test_util/gpu.h"
#include "tests/test_util/random.h"

namespace palpate {
namespace {

using test::Random;

constexpr int kWidth = 131, kHeight = 97;
constexpr Intrinsics kIntrinsics{108, 104, 66.3, 47.1};

std::size_t index(int u, int v) { return static_cast<std::size_t>(v * kWidth + u); }

/// Every kind of triangle: small and large ones, slivers, open meshes, some without any area.
std::vector<RobotLink> all_kinds_of_links() {
  std::vector<RobotLink> links = test::arm_links();
  links.push_back({"ball", make_icosphere(0.07, 3)});
  links.push_back({"wire", make_cylinder(0.0004, 0.6, 6)});
  links.push_back({"rod", make_box({0.02, 0.03, 2.5})});
  TriangleMesh odd;
  odd.vertices = {{0, 0, 0}, {0.2, 0, 0}, {0.1, 0, 0}, {0, 0.3, 0.1}, {0, 0, 0}};
  odd.triangles = {{0, 1, 2}, {0, 0, 3}, {0, 1, 3}, {4, 0, 4}};
  links.push_back({"odd", odd});
  links.push_back({"nothing", {}});
  return links;
}

DepthFrame random_frame(Random& random) {
  DepthFrame frame{kWidth, kHeight, 0.001, std::vector<std::uint16_t>(index(0, kHeight))};
  for (std::uint16_t& count : frame.pixels) {
    count = static_cast<std::uint16_t>(random.uniform(0, 1) < 0.1 ? 0 : random.uniform(40, 3000));
  }
  return frame;
}

int remove_on_cpu(LinkImage& image, const std::vector<RobotLink>& links,
                  const std::vector<Pose>& X_CL, DepthFrame& frame) {
  image.begin(frame.width, frame.height);
  for (std::size_t i = 0; i < links.size(); ++i) image.add(links[i].mesh, X_CL[i]);
  image.draw();
  return image.remove_from(frame);
}

class LinksOnGpuTest : public testing::TestWithParam<double> {};

TEST_P(LinksOnGpuTest, RemoveTheBitsThatTheCpuRemoves) {
  PALPATE_GPU_OR_SKIP();
  const double padding = GetParam();
  test::in_all_orders([&] {
    Random random(5);
    const std::vector<RobotLink> links = all_kinds_of_links();
    const auto on_gpu = make_links_on_gpu(links, kIntrinsics, kWidth, kHeight, padding, 0).value();
    LinkImage image(kIntrinsics, padding);
    int num_removed = 0, num_left = 0;
    for (int round = 0; round < 8; ++round) {
      // From beside the image and right before the camera, and through it, to far away.
      std::vector<Pose> X_CL;
      while (X_CL.size() < links.size()) {
        X_CL.push_back({random.in_box(0.5) + Vec3d{0, 0, 0.1 + 0.3 * round}, random.rotation(3)});
      }
      const DepthFrame seen = random_frame(random);
      DepthFrame want = seen, got = seen;
      num_removed += remove_on_cpu(image, links, X_CL, want);
      ASSERT_TRUE(on_gpu->remove_from(got, X_CL).value());
      ASSERT_EQ(got.pixels, want.pixels) << round;
      num_left += static_cast<int>(std::ranges::count_if(got.pixels, [](int i) { return i > 0; }));
    }
    EXPECT_GT(num_removed, 4000);
    EXPECT_GT(num_left, 8000);
  });
}
INSTANTIATE_TEST_SUITE_P(Paddings, LinksOnGpuTest, testing::Values(0.0, 0.01, 0.03));

struct Triangle {
  Vec3d a, b, c;
};

double distance_to(const Triangle& t, const Vec3d& p) {
  const Vec3d n = cross(t.b - t.a, t.c - t.a);
  const auto is_left = [&](const Vec3d& u, const Vec3d& v) {
    return dot(cross(v - u, p - u), n) >= 0;
  };
  if (norm(n) > 1e-12 && is_left(t.a, t.b) && is_left(t.b, t.c) && is_left(t.c, t.a)) {
    return std::abs(dot(n, p - t.a)) / norm(n);
  }
  const auto to_edge = [&](const Vec3d& u, const Vec3d& v) {
    const double s = std::clamp(dot(p - u, v - u) / dot(v - u, v - u), 0.0, 1.0);
    return norm(p - (u + (v - u) * s));
  };
  return std::min({to_edge(t.a, t.b), to_edge(t.b, t.c), to_edge(t.c, t.a)});
}

/// m along the ray of a pixel to the nearest triangle, in depth; infinite if it meets none.
double depth_by_ray(const std::vector<Triangle>& triangles, const Vec3d& ray) {
  double nearest = std::numeric_limits<double>::infinity();
  for (const auto& [a, b, c] : triangles) {
    const Vec3d ab = b - a, ac = c - a, p = cross(ray, ac);
    const double det = dot(ab, p);
    if (std::abs(det) < 1e-15) continue;
    const double s = -dot(a, p) / det;
    const Vec3d q = cross(-a, ab);
    const double t = dot(ray, q) / det, z = dot(ac, q) / det;
    if (s >= 0 && t >= 0 && s + t <= 1 && z > 0) nearest = std::min(nearest, z);
  }
  return nearest;
}

/// All that is measured on or behind the links, or nearer to them than the padding, goes; and what
/// is far from them in the image or in front of them stays.
TEST(LinksOnGpu, AreRightByRaysAndDistances) {
  PALPATE_GPU_OR_SKIP();
  constexpr double kPadding = 0.02;
  Random random(12);
  std::vector<RobotLink> links{{"box", make_box({0.12, 0.2, 0.06})},
                               {"can", make_cylinder(0.06, 0.25, 9)},
                               {"ball", make_icosphere(0.08, 1)}};
  const auto on_gpu = make_links_on_gpu(links, kIntrinsics, kWidth, kHeight, kPadding, 0).value();
  int num_shown = 0, num_padded = 0, num_in_front = 0, num_beside = 0;
  for (int round = 0; round < 3; ++round) {
    std::vector<Pose> X_CL;
    std::vector<Triangle> triangles;
    double nearest = 10;
    for (const RobotLink& link : links) {
      X_CL.push_back({random.in_box(0.35) + Vec3d{0, 0, 0.75 + 0.3 * round}, random.rotation(3)});
      for (const auto& ids : link.mesh.triangles) {
        Triangle t;
        t.a = X_CL.back() * link.mesh.vertices[ids[0]];
        t.b = X_CL.back() * link.mesh.vertices[ids[1]];
        t.c = X_CL.back() * link.mesh.vertices[ids[2]];
        nearest = std::min({nearest, t.a.z, t.b.z, t.c.z});
        triangles.push_back(t);
      }
    }
    const DepthFrame seen = random_frame(random);
    DepthFrame left = seen;
    ASSERT_TRUE(on_gpu->remove_from(left, X_CL).value());
    // Largest reach of the links in the plane at depth 1: of squares, a quarter nearer, at the
    // image's corner, where the padding is widest.
    const double reach = std::sqrt(2) * (1.7 * kPadding / nearest + 3.5 / kIntrinsics.fy);
    for (int v = 0; v < kHeight; ++v) {
      for (int u = 0; u < kWidth; ++u) {
        const int count = seen.pixels[index(u, v)];
        if (count == 0) continue;
        const Vec3d ray{(u - kIntrinsics.cx) / kIntrinsics.fx,
                        (v - kIntrinsics.cy) / kIntrinsics.fy, 1};
        const double depth = 0.001 * count;
        const bool is_left = left.pixels[index(u, v)] != 0;
        double apart = 10, beside = 10;
        for (const Triangle& t : triangles) {
          apart = std::min(apart, distance_to(t, ray * depth));
          const Triangle flat{t.a * (1 / t.a.z), t.b * (1 / t.b.z), t.c * (1 / t.c.z)};
          beside = std::min(beside, distance_to(flat, ray));
        }
        if (depth_by_ray(triangles, ray) <= depth) {
          ++num_shown;
          ASSERT_FALSE(is_left) << u << " " << v << " of " << round;
        } else if (apart < kPadding) {
          ++num_padded;
          ASSERT_FALSE(is_left) << u << " " << v << " of " << round;
        } else if (depth < nearest - kPadding - 1e-3) {
          ++num_in_front;
          ASSERT_EQ(left.pixels[index(u, v)], count);
        } else if (beside > reach) {
          ++num_beside;
          ASSERT_EQ(left.pixels[index(u, v)], count) << u << " " << v << " of " << round;
        }
      }
    }
  }
  EXPECT_GT(num_shown, 1000);
  EXPECT_GT(num_padded, 20);
  EXPECT_GT(num_in_front, 1000);
  EXPECT_GT(num_beside, 3000);
}

TEST(LinksOnGpu, SayThatAFrameIsNotForThem) {
  PALPATE_GPU_OR_SKIP();
  constexpr double kPadding = 0.09;
  const std::vector<RobotLink> links{{"plate", make_box({3, 3, 0.02})}};
  const auto on_gpu = make_links_on_gpu(links, kIntrinsics, kWidth, kHeight, kPadding, 0).value();
  LinkImage image(kIntrinsics, kPadding);
  Random random(3);
  const DepthFrame seen = random_frame(random);
  const std::vector<Pose> too_near{{{0, 0, 0.07}, {}}}, far{{{2.5, 0, 2.5}, {}}};
  for (int round = 0; round < 2; ++round) {
    DepthFrame frame = seen;
    EXPECT_FALSE(on_gpu->remove_from(frame, too_near).value());
    EXPECT_EQ(frame.pixels, seen.pixels);
    // And the next one is as if nothing had been.
    DepthFrame want = seen;
    EXPECT_GT(remove_on_cpu(image, links, far, want), 300);
    ASSERT_TRUE(on_gpu->remove_from(frame, far).value());
    EXPECT_EQ(frame.pixels, want.pixels);
  }
  DepthFrame small{64, 48, 0.001, std::vector<std::uint16_t>(64 * 48, 900)};
  EXPECT_FALSE(on_gpu->remove_from(small, far).value());
  EXPECT_EQ(std::ranges::count(small.pixels, 900), 64 * 48);
}

TEST(LinksOnGpu, AreRefusedWithoutAGpu) {
  if (gpu::check_gpu(0)) GTEST_SKIP() << "SKIPPED: there is a GPU";
  EXPECT_FALSE(make_links_on_gpu({}, kIntrinsics, kWidth, kHeight, 0.01, 0));
}

#if defined(PALPATE_EMULATE_CUDA)
TEST(LinksOnGpu, SayThatTheGpuIsLost) {
  const std::vector<RobotLink> links{{"ball", make_icosphere(0.1, 2)}};
  const auto on_gpu = make_links_on_gpu(links, kIntrinsics, kWidth, kHeight, 0.01, 0).value();
  Random random(3);
  const DepthFrame seen = random_frame(random);
  DepthFrame frame = seen;
  emulator::lose_gpu(true);
  const auto done = on_gpu->remove_from(frame, std::vector<Pose>{{{0, 0, 0.8}, {}}});
  emulator::lose_gpu(false);
  EXPECT_FALSE(done);
  EXPECT_EQ(frame.pixels, seen.pixels);
}
#endif

}  // namespace
}  // namespace palpate
