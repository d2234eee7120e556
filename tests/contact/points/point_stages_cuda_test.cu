// The first stages of the point-hit methods on a GPU against those of the CPU: same sums, same
// boundary spheres, same edges.
#include <cmath>
#include <cstdint>
#include <limits>
#include <utility>
#include <vector>

#include <gtest/gtest.h>

#include "tests/contact/points/point_stages_rig.cuh"
#include "tests/test_util/contact_scenes.h"
#include "tests/test_util/gpu.h"

namespace palpate {
namespace {

using namespace test::point_stages;  // NOLINT: all of it

constexpr float kNan = std::numeric_limits<float>::quiet_NaN();

constexpr PointWeights kAllWeights[] = {PointWeights::none, PointWeights::beside,
                                        PointWeights::in_sums};

Pose tilted(double x, double y, double z) { return {{x, y, z}, axis_angle({0.3, -1, 0.5}, 0.7)}; }

// Side by side, the cube's middle in the origin.
std::vector<Sphere> cube_of_spheres(int num_along_side, double spacing) {
  std::vector<Sphere> spheres;
  const double low = -0.5 * (num_along_side - 1);
  for (int x = 0; x < num_along_side; ++x) {
    for (int y = 0; y < num_along_side; ++y) {
      for (int z = 0; z < num_along_side; ++z) {
        spheres.push_back({to_float(Vec3d{low + x, low + y, low + z} * spacing),
                           static_cast<float>(0.49 * spacing)});
      }
    }
  }
  return spheres;
}

// An unorganized cloud.
PointCloud loose_cloud(const std::vector<Vec3d>& points, std::uint64_t seed) {
  test::Random random(seed);
  PointCloud cloud(static_cast<int>(points.size()), 1);
  for (std::size_t i = 0; i < points.size(); ++i) {
    cloud.set(i, to_float(points[i]), to_float(Vec3d{0, 0, -1} + 0.9 * random.direction()));
  }
  return cloud;
}

TEST(PointStages, FindTheBoundaryOfTheCpuInAnOrganizedCloud) {
  PALPATE_GPU_OR_SKIP();
  const PointCloud cloud = test::noisy_wall(97, 72, 180, 0.5, 0.003, 5);
  const Scene scene{test::random_spheres(300, 0.1, 3), cloud.view()};
  OnGpu on_gpu(scene);
  for (const PointWeights weights : kAllWeights) {
    for (const double depth : {0.43, 0.5, 0.59}) {
      const Question question{tilted(0.02, -0.03, depth), weights};
      const Found want = query_cpu(scene, question);
      ASSERT_GT(want.ids.size(), 10u);
      expect_same(on_gpu.evaluate(question), want);
    }
  }
}

TEST(PointStages, FindTheBoundaryOfTheCpuInAnUnorganizedCloud) {
  PALPATE_GPU_OR_SKIP();
  test::Random random(7);
  std::vector<Vec3d> points;
  for (int i = 0; i < 5003; ++i) points.push_back(Vec3d{0.1, 0, 0.4} + random.in_box(0.15));
  const PointCloud cloud = loose_cloud(points, 9);
  const Scene scene{test::random_spheres(200, 0.1, 4), cloud.view()};
  OnGpu on_gpu(scene);
  for (const PointWeights weights : kAllWeights) {
    const Question question{tilted(0.1, 0.01, 0.38), weights};
    const Found want = query_cpu(scene, question);
    EXPECT_GT(want.num_points, 200);
    expect_same(on_gpu.evaluate(question), want);
  }
}

// Points on the surfaces of spheres, and one rounding beside them: decided in double.
TEST(PointStages, DecideCloseCallsLikeTheCpu) {
  PALPATE_GPU_OR_SKIP();
  const std::vector<Sphere> spheres = test::random_spheres(200, 0.1, 11);
  const Question question{tilted(0.3, 0.2, 0.6)};
  test::Random random(13);
  std::vector<Vec3d> points;
  for (int i = 0; i < 4000; ++i) {
    const Sphere& s = spheres[random.bits() % spheres.size()];
    const double r = static_cast<double>(s.radius) * (1 + 1e-7 * (i % 3 - 1));
    points.push_back(question.X_WT * (to_double(s.center) + r * random.direction()));
  }
  const PointCloud cloud = loose_cloud(points, 15);
  const Scene scene{spheres, cloud.view()};
  const Found want = query_cpu(scene, question);
  EXPECT_GT(want.num_points, 1000);
  EXPECT_LT(want.num_points, 3000);
  OnGpu on_gpu(scene);
  expect_same(on_gpu.evaluate(question), want);
}

TEST(PointStages, AddThousandsOfPointsInOneSphere) {
  PALPATE_GPU_OR_SKIP();
  const PointCloud cloud = test::noisy_wall(96, 72, 400, 0.5, 0.001, 5);
  const Scene scene{{{{0, 0, 0}, 0.09f}, {{0, 0, 0.1f}, 0.005f}}, cloud.view()};
  OnGpu on_gpu(scene);
  for (const PointWeights weights : kAllWeights) {
    const Question question{tilted(0, 0, 0.5), weights};
    const Found want = query_cpu(scene, question);
    EXPECT_GT(want.num_points, 6000);
    expect_same(on_gpu.evaluate(question), want);
  }
}

TEST(PointStages, FindNothingWhereNothingIs) {
  PALPATE_GPU_OR_SKIP();
  const PointCloud wall = test::noisy_wall(96, 72, 90, 0.5, 0.003, 5), empty;
  const PointCloud invalid(96, 72, Intrinsics{90, 90, 48, 36});
  for (const PointCloud* cloud : {&wall, &empty, &invalid}) {
    const Scene scene{test::random_spheres(50, 0.1, 3), cloud->view()};
    OnGpu on_gpu(scene);
    const Found found = on_gpu.evaluate({tilted(0, 0, 0.2)});
    EXPECT_TRUE(found.ids.empty());
    EXPECT_EQ(found.num_points, 0);
  }
}

// More words of touched bits, and more touched spheres, than a block looks at at once.
TEST(PointStages, ListManySpheresInOrder) {
  PALPATE_GPU_OR_SKIP();
  test::Random random(17);
  std::vector<Vec3d> points;
  for (int i = 0; i < 6000; ++i) {
    points.push_back(random.in_box(i % 2 == 0 ? 0.07 : 0.02));
  }
  const PointCloud cloud = loose_cloud(points, 19);
  const Scene scene{cube_of_spheres(28, 0.005), cloud.view()};
  const Question question{};
  const Found want = query_cpu(scene, question);
  EXPECT_GT(want.ids.size(), 2u * kQueryThreads);
  for (const int blocks : {1, 3}) {
    OnGpu on_gpu(scene, blocks);
    expect_same(on_gpu.evaluate(question), want);
  }
}

// A near wall with a corner in front of a far one, with strips of missing pixels at its border: the
// edge is known at some pixels, and behind a hole at others.
struct SteppedWall {
  test::CloudWithEdges cloud = test::stepped_wall(96, 72, 90, 0.5, 0.12, 0.002, 21,
                                                  [](int u, int v) { return u < 50 && v > 30; });

  SteppedWall() {
    for (int v = 0; v < 72; ++v) {
      for (int u = 0; u < 96; ++u) {
        if ((u == 51 || u == 52) && v % 16 < 8) remove(u, v);
        // Nothing is known beside these.
        if (v % 16 < 9 && u >= 48 && u <= 50) forget_edge(u, v);
      }
    }
  }
  void remove(int u, int v) {
    for (int k = 0; k < 6; ++k) cloud.cloud.channel(k)[v * 96 + u] = kNan;
    forget_edge(u, v);
  }
  void forget_edge(int u, int v) {
    for (std::vector<float>& axis : cloud.edge) axis[static_cast<std::size_t>(v * 96 + u)] = 0;
  }
};

TEST(PointStages, FindTheEdgesOfTheCpu) {
  PALPATE_GPU_OR_SKIP();
  const SteppedWall wall;
  const Scene scene{cube_of_spheres(15, 0.013), wall.cloud.view()};
  OnGpu on_gpu(scene);
  for (const Edges edges : {Edges::cut, Edges::center, Edges::strict}) {
    for (const PointWeights weights : kAllWeights) {
      for (const double y : {0.01, 0.16}) {  // in the middle, and at the border of the image
        const double depth = edges == Edges::cut ? 0.5 : 0.55;
        const Question question{tilted(0.02, y, depth), weights, edges};
        const Found want = query_cpu(scene, question);
        EXPECT_GT(want.pieces.size(), 3u);
        expect_same(on_gpu.evaluate(question), want);
      }
    }
  }
}

// A tool around the camera: some spheres are behind it.
TEST(PointStages, FindEdgesForSpheresThatTheCameraSees) {
  PALPATE_GPU_OR_SKIP();
  const SteppedWall wall;
  const Scene scene{cube_of_spheres(17, 0.07), wall.cloud.view()};
  OnGpu on_gpu(scene);
  const Question question{tilted(0, 0, 0.2), PointWeights::none, Edges::cut};
  const Found want = query_cpu(scene, question);
  EXPECT_GT(want.pieces.size(), 3u);
  expect_same(on_gpu.evaluate(question), want);
}

// Pieces at the corners of a lattice, and most of them twice; spheres seen between them.
TEST(PointStages, FindTheFirstOfTheNearestPieces) {
  PALPATE_GPU_OR_SKIP();
  const Scene scene{cube_of_spheres(8, 1), PointCloudView{}};
  std::vector<Sphere> spheres;
  for (const Sphere& s : scene.spheres) {
    const float z = s.center.z < 0 ? 0.5f : 1.0f;  // powers of two: distances are exact
    spheres.push_back({{s.center.x * z, s.center.y * z, z}, 0.01f});
  }
  const Scene in_view{spheres, PointCloudView{}};
  std::vector<EdgePiece> pieces;
  for (int i = 0; i < 100; ++i) {
    EdgePiece piece;
    piece.u = i * 7 % 9 - 4;
    piece.v = i * 5 % 8 - 4;
    piece.range = 1;
    pieces.push_back(piece);
  }
  const std::vector<std::int32_t> got = OnGpu(in_view).nearest(pieces);
  for (std::size_t id = 0; id < spheres.size(); ++id) {
    const Vec3d c = to_double(spheres[id].center);
    double least = 1e300;
    std::int32_t first = -1;
    for (std::size_t i = 0; i < pieces.size(); ++i) {
      const double du = pieces[i].u - c.x / c.z, dv = pieces[i].v - c.y / c.z;
      if (du * du + dv * dv < least) {
        least = du * du + dv * dv;
        first = static_cast<std::int32_t>(i);
      }
    }
    ASSERT_EQ(got[id], first) << id;
  }
}

#if defined(PALPATE_EMULATE_CUDA)
TEST(PointStages, DoNotDependOnTheOrderOfThreads) {
  const SteppedWall wall;
  const Scene scene{cube_of_spheres(15, 0.013), wall.cloud.view()};
  const Question question{tilted(0.02, 0.01, 0.52), PointWeights::beside, Edges::cut};
  const Found want = query_cpu(scene, question);
  for (const std::uint32_t seed : {1u, 2u, 3u}) {
    emulator::set_order(seed);
    OnGpu on_gpu(scene);
    expect_same(on_gpu.evaluate(question), want);
    expect_same(on_gpu.evaluate(question), want);
  }
  emulator::set_order(0);
}
#endif

}  // namespace
}  // namespace palpate
