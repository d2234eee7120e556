// The methods that stand beside ours do what they are known for where the answer is plain: a wall.
#include "eval/studies/other_methods.h"

#include <gtest/gtest.h>

#include "src/math/internal/random.h"

namespace palpate::eval {
namespace {

/// A wall at z = 1 m, without noise.
RenderedScene wall() { return see(at_the_wall(thesis_cases().front()), DepthNoise::none); }

TEST(DistanceGrid, IsTheDistanceFromAWallOnBothSides) {
  const RenderedScene seen = wall();
  constexpr double kVoxel = 0.005;
  const DistanceGrid grid(seen.surface.cloud(), {0, 0, 1}, 0.3, kVoxel);
  Random random(1);
  for (int i = 0; i < 2000; ++i) {
    const Vec3d p = Vec3d{0, 0, 1} + random.in_box(0.1);
    const scenes::SignedDistance got = grid.at(p);
    // Right at the surface the sign of a voxel's middle decides.
    const double allowed = std::abs(p.z - 1) < 2 * kVoxel ? kVoxel : 0.1 * kVoxel;
    EXPECT_NEAR(got.distance, 1 - p.z, allowed);
    if (std::abs(p.z - 1) > 2 * kVoxel) {
      EXPECT_NEAR(got.gradient.z, -1, 1e-2);
    }
  }
  EXPECT_GT(grid.at({0, 0, 2}).distance, 1) << "free space beyond the grid";
}

/// Cells that no point lies in know the nearest one, however far and whatever lies between.
TEST(DistanceGrid, IsTheDistanceFromABall) {
  for (const ContactCase& c : tilted_cases()) {
    if (c.scene != "sphere-out-160") continue;
    const RenderedScene seen = see(c, DepthNoise::none);
    constexpr double kCell = 0.01;
    const DistanceGrid grid(seen.surface.cloud(), {0, 0, 1}, 0.4, kCell);
    Random random(2);
    for (int i = 0; i < 2000; ++i) {
      // The nearest point of the ball is visible from here and lies in the grid.
      const Vec3d p = Vec3d{0, 0, 1} + random.in_box(0.06);
      const scenes::SignedDistance exact = scenes::signed_distance(c.environment, p);
      if (std::abs(exact.distance) < 2 * kCell) continue;
      EXPECT_NEAR(grid.at(p).distance, exact.distance, 0.25 * kCell);
      EXPECT_GT(dot(grid.at(p).gradient, exact.gradient), 0.9) << "towards the mean of a cell";
    }
  }
}

TEST(DistanceGrid, TheHingeSumsDepthsOfSpheres) {
  const RenderedScene seen = wall();
  const Tool tool = packed_tool(thesis_cases().front(), 100);
  const DistanceGrid grid(seen.surface.cloud(), {0, 0, 1}, 0.4, 0.005);
  const Pose X_WT{{0.01, -0.02, 0.98}, axis_angle({1, 2, 3}, 0.4)};
  const Vec3d middle = X_WT * tool.sphere_mass().center_of_mass;
  VolumeWrench expected;
  for (const Sphere& s : tool.spheres()) {
    const Vec3d c = X_WT * to_double(s.center);
    const Vec3d force{0, 0, -std::max(0.0, static_cast<double>(s.radius) - (1 - c.z))};
    expected.force += force;
    expected.torque += cross(c - middle, force);
  }
  const VolumeWrench got = grid.hinge(tool, X_WT).measure_W;
  EXPECT_LT(norm(got.force - expected.force), 0.02 * norm(expected.force));
  EXPECT_LT(norm(got.torque - expected.torque), 0.02 * norm(expected.force) * 0.1);
}

TEST(GodObject, StaysOnTheWallAndSlidesAlongIt) {
  const RenderedScene seen = wall();
  GodObject proxy(seen.surface.cloud(), 0.01);
  EXPECT_EQ(proxy.pull({0, 0, 0.95}), Vec3d{}) << "in front";
  for (int i = 0; i <= 100; ++i) {
    const Vec3d p{0.0005 * i, -0.0002 * i, 0.999 + 0.0003 * i};
    const Vec3d pull = proxy.pull(p);
    EXPECT_NEAR(pull.z, -std::max(0.0, p.z - 1), 2e-4) << i;
    EXPECT_NEAR(std::hypot(pull.x, pull.y), 0, 2e-4) << i;
  }
  EXPECT_EQ(proxy.pull({0, 0, 0.99}), Vec3d{}) << "it lets go";
}

}  // namespace
}  // namespace palpate::eval
