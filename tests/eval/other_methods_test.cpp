// The methods that stand beside ours do what they are known for where the answer is plain: a wall.
#include "eval/studies/other_methods.h"

#include <gtest/gtest.h>

#include "eval/studies/random.h"

namespace palpate::eval {
namespace {

/// A wall at z = 1 m, without noise.
SeenScene wall() { return see(at_the_wall(thesis_cases().front()), DepthNoise::none); }

TEST(DistanceGrid, IsTheDistanceFromAWallOnBothSides) {
  const SeenScene seen = wall();
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
  EXPECT_EQ(grid.num_bytes(), 60u * 60 * 60 * sizeof(float));
}

TEST(GodObject, StaysOnTheWallAndSlidesAlongIt) {
  const SeenScene seen = wall();
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
