// The yardstick of scenes that are meshes, against closed forms.
#include "eval/studies/mesh_truth.h"

#include <gtest/gtest.h>

#include "scenes/truth.h"
#include "tests/test_util/random.h"

namespace palpate::eval {
namespace {

// A box of a meter is a wall for a small tool, at any angle of tool and wall.
TEST(MeshTruth, OfABlockIsThatOfAWall) {
  const TriangleMesh block = make_shape("box", 1).value(),
                     tool = make_shape("octahedron", 0.1).value();
  const MeshInside inside(block);
  const double whole = mass_properties(tool).volume;
  const std::vector<Vec3d> points = points_inside(tool, 0.001);
  EXPECT_NEAR(static_cast<double>(points.size()) * 1e-9 / whole, 1, 0.01);
  test::Random random(3);
  for (const double depth : {-0.06, -0.03, 0.0, 0.02, 0.06}) {
    // The face towards -z, at z = -0.5; the wall of the closed form is at z = 1.
    const Pose X_BT{{random.uniform(-0.1, 0.1), random.uniform(-0.1, 0.1), -0.5 + depth},
                    random.rotation(3.0)};
    const Pose X_WT{X_BT.translation + Vec3d{0, 0, 1.5}, X_BT.rotation};
    const auto exact = scenes::exact_penetration(tool, X_WT, {}, scenes::Environment::wall(1));
    const SampledPenetration got = sampled_penetration(points, X_BT, inside);
    EXPECT_NEAR(got.share, exact.volume / whole, 0.004) << depth;
    EXPECT_LT(norm(got.force - 1 / whole * exact.measure_C_W.force), 0.004) << depth;
  }
}

// Round surfaces: balls that overlap have a volume in closed form, and push along the
// line of their centers.
TEST(MeshTruth, OfTwoBallsIsTheirLens) {
  const double big = 0.1, small = 0.04, apart = 0.09;
  const TriangleMesh body = make_shape("sphere", 2 * big).value(),
                     tool = make_shape("sphere", 2 * small).value();
  const MeshInside inside(body);
  const std::vector<Vec3d> points = points_inside(tool, 0.0008);
  const double reach = big + small - apart, difference = big - small;
  const double lens = kPi * reach * reach *
                      (apart * apart + 2 * apart * (big + small) - 3 * difference * difference) /
                      (12 * apart);
  const Vec3d way = normalized(Vec3d{0.3, -0.5, 0.8});
  const SampledPenetration got = sampled_penetration(points, {apart * way, {}}, inside);
  EXPECT_NEAR(got.share, lens / (4 * kPi / 3 * small * small * small), 0.01);
  EXPECT_LT(norm(cross(got.force, way)), 0.01 * norm(got.force));
  EXPECT_GT(dot(got.force, way), 0.9 * got.share);
  EXPECT_LE(norm(got.force), got.share);
  EXPECT_EQ(sampled_penetration(points, {0.2 * way, {}}, inside).share, 0);
}

}  // namespace
}  // namespace palpate::eval
