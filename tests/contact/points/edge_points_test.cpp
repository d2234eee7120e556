// Edges of a surface in the image, by the words of EdgeSums and pixel by pixel.
#include "src/contact/points/edges/edge_points.h"

#include <cmath>
#include <vector>

#include <gtest/gtest.h>

#include "tests/test_util/contact_scenes.h"

namespace palpate {
namespace {

/// A step between two walls with many holes along it and no depth-change vectors.
test::CloudWithEdges ragged_step(int width, int height, std::uint64_t seed) {
  test::Random random(seed);
  test::CloudWithEdges scene{PointCloud(width, height, Intrinsics{90, 95, 40, 30}), {}};
  for (std::vector<float>& axis : scene.edge) axis.assign(scene.cloud.size(), 0);
  for (int v = 0; v < height; ++v) {
    for (int u = 0; u < width; ++u) {
      if (random.uniform() < 0.3 || (u > 20 && u < 26 && v > 8)) continue;
      const double z = 0.5 + random.uniform(0, 0.2) + (random.uniform() < 0.3 ? 0.3 : 0);
      scene.cloud.set(static_cast<std::size_t>(v * width + u),
                      to_float({(u - 40) * z / 90, (v - 30) * z / 95, z}), {0, 0, -1});
    }
  }
  return scene;
}

TEST(EdgePoints, LookAcrossHolesToWhatLiesBehind) {
  // Wider than the widest hole that is looked across.
  for (const auto& [width, height] : {std::pair{80, 12}, {9, 90}, {7, 7}}) {
    test::CloudWithEdges scene = ragged_step(width, height, 3);
    if (width == 80) {
      for (int u = 3; u < 70; ++u) scene.cloud.channel(2)[5 * width + u] = NAN;  // 67 in a row
      for (int u = 3; u < 67; ++u) scene.cloud.channel(2)[7 * width + u] = NAN;  // 64: too many
      for (int u = 4; u < 67; ++u) scene.cloud.channel(2)[9 * width + u] = NAN;  // 63
    }
    const PointCloudView view = scene.view();
    const EdgePoints points{&view};
    const auto depth = [&](int u, int v) { return static_cast<double>(view.z[v * width + u]); };
    int num_changes = 0;
    for (int v = 0; v < height; ++v) {
      for (int u = 0; u < width; ++u) {
        const std::int32_t i = v * width + u;
        // To the right, left, down and up: across missing pixels, at most kMaxHole steps away.
        const int steps[4][2] = {{1, 0}, {-1, 0}, {0, 1}, {0, -1}};
        double change[2] = {};
        bool is_beside_hole = false;
        for (const auto& [du, dv] : steps) {
          for (int n = 1; n <= EdgeSums::kMaxHole; ++n) {
            const int at_u = u + n * du, at_v = v + n * dv;
            if (at_u < 0 || at_v < 0 || at_u >= width || at_v >= height) break;
            const double z = depth(at_u, at_v);
            is_beside_hole |= n == 1 && std::isnan(z);
            if (std::isnan(z)) continue;
            const double more = z - depth(u, v) - EdgeSums::kMinStep;
            if (n > 1 && more > 0) change[du == 0] += (du + dv) * more;
            break;
          }
        }
        const Vec3d got = points.change(i, v, u);
        Vec3d want;
        if (!std::isnan(depth(u, v)) && (change[0] != 0 || change[1] != 0)) {
          const Vec3d ray = normalized(points.point(i)), l{change[0], change[1], 0};
          want = l - dot(l, ray) * ray;  // across the line of sight
          ++num_changes;
        }
        ASSERT_LT(norm(got - want), 1e-12) << u << " " << v;
        EXPECT_EQ(points.may_be_edge(i, v, u), is_beside_hole) << u << " " << v;
        EXPECT_EQ(EdgePoints::is_edge(got), norm(got) > EdgeSums::kMinChange);
      }
    }
    EXPECT_GT(num_changes, width * height / 10);
  }
}

// A change that the camera saw itself takes precedence over holes beside it.
TEST(EdgePoints, KnownChangesComeFirst) {
  test::CloudWithEdges scene = ragged_step(40, 12, 5);
  const std::size_t i = 5 * 40 + 15;
  for (const std::size_t k : {i - 1, i + 1, i - 40, i + 40}) scene.cloud.channel(2)[k] = NAN;
  scene.cloud.set(i, {0, 0, 0.4f}, {0, 0, -1});
  for (const auto& [x, y] : {std::pair{0.02f, 0.0f}, {0.0f, -0.03f}, {0.001f, 0.002f}}) {
    scene.edge[0][i] = x, scene.edge[1][i] = y, scene.edge[2][i] = 0.001f;
    const PointCloudView view = scene.view();
    const EdgePoints points{&view};
    const Vec3d got = points.change(static_cast<std::int32_t>(i), 5, 15);
    EXPECT_EQ(got, to_double(Vec3f{x, y, 0.001f}));
    EXPECT_EQ(points.may_be_edge(static_cast<std::int32_t>(i), 5, 15), norm(got) > 0.005);
  }
}

TEST(EdgePoints, BelongTogetherOnOneSurfaceTowardsOneSide) {
  PointCloud cloud(3, 1, Intrinsics{90, 95, 1, 0});
  const float depths[] = {0.5f, 0.515f, 0.53f};
  for (std::size_t i = 0; i < 3; ++i) cloud.set(i, {0, 0, depths[i]}, {0, 0, -1});
  const PointCloudView view = cloud.view();
  const EdgePoints points{&view};
  const Vec3d right{0.1, 0, 0}, aslant{0.05, 0.2, 0}, left{-0.1, 0.2, 0}, up{0, -0.1, 0};
  for (const auto& [a, b] : {std::pair{0, 1}, {1, 0}, {1, 2}, {2, 1}}) {
    EXPECT_TRUE(points.belong_together(a, right, b, aslant));
    EXPECT_FALSE(points.belong_together(a, right, b, left));
    EXPECT_FALSE(points.belong_together(a, right, b, up)) << "at a right angle";
  }
  EXPECT_FALSE(points.belong_together(0, right, 2, aslant)) << "3 cm deeper";
  EXPECT_FALSE(points.belong_together(2, right, 0, aslant)) << "3 cm nearer";
  cloud.channel(2)[1] = NAN;
  EXPECT_FALSE(points.belong_together(0, right, 1, aslant));
}

TEST(EdgePoints, TheMeanEdgeHasAPlaceASideAndALengthOfOne) {
  EdgeMean mean;
  mean.add({1, 2, 3}, {0.3, 0, 0});
  mean.add({3, 2, 5}, {0.3, 0.8, 0});
  EXPECT_LT(norm(mean.offset({1, 1, 1}) - Vec3d{1, 1, 3}), 1e-15);
  EXPECT_LT(norm(mean.unit_change() - Vec3d{0.6, 0.8, 0}), 1e-15);
  const auto direction = [](const Vec3d& change) {
    EdgeMean one;
    one.add({}, change);
    return one.direction();
  };
  EXPECT_EQ(direction({2, 1, 0}), 0);
  EXPECT_EQ(direction({-2, 1, 0}), 1);
  EXPECT_EQ(direction({1, 2, 0}), 2);
  EXPECT_EQ(direction({1, -2, 0}), 3);
  EXPECT_EQ(direction({1, -1, 0}), 0);
  EXPECT_EQ(direction({-1, -1, 0}), 1);
}

}  // namespace
}  // namespace palpate
