#include "palpate/math/geometry.h"

#include <gtest/gtest.h>

#include "tests/test_util/random.h"

namespace palpate {
namespace {

TEST(Pose, ChainsLikeDominoes) {
  test::Random random(1);
  for (int i = 0; i < 100; ++i) {
    const Pose X_AB{random.in_box(2), random.rotation(3)},
        X_BC{random.in_box(2), random.rotation(3)};
    const Vec3d p_C = random.in_box(1);
    EXPECT_LT(norm((X_AB * X_BC) * p_C - X_AB * (X_BC * p_C)), 1e-14 * 10);
    EXPECT_LT(norm(inverse(X_AB) * (X_AB * p_C) - p_C), 1e-14 * 10);
  }
}

TEST(Pose, QuarterTurnAboutZ) {
  const Pose X{{1, 2, 3}, axis_angle({0, 0, 2}, kPi / 2)};
  EXPECT_LT(norm(X * Vec3d{1, 0, 0} - Vec3d{1, 3, 3}), 1e-15 * 10);
}

TEST(Pose, InterpolationTakesTheShortWayAtConstantSpeed) {
  const Pose a{{0, 0, 0}, {}};
  Pose b{{1, 0, 0}, axis_angle({0, 1, 0}, 1.0)};
  b.rotation = {-b.rotation.x, -b.rotation.y, -b.rotation.z, -b.rotation.w};  // same rotation
  for (double t : {0.0, 0.25, 0.5, 1.0}) {
    const Pose c = interpolate(a, b, t);
    EXPECT_NEAR(c.translation.x, t, 1e-15);
    const Vec3d want = rotate(axis_angle({0, 1, 0}, t), {0, 0, 1});
    EXPECT_LT(norm(rotate(c.rotation, {0, 0, 1}) - want), 1e-12);
  }
  // Nearly equal rotations take the straight path of the same function.
  const Pose near{{0, 0, 0}, axis_angle({0, 1, 0}, 1e-4)};
  EXPECT_LT(norm(rotate(interpolate(a, near, 0.5).rotation, {0, 0, 1}) -
                 rotate(axis_angle({0, 1, 0}, 5e-5), {0, 0, 1})),
            1e-12);
}

TEST(Vec3, CrossIsRightHanded) {
  EXPECT_EQ(cross(Vec3d{1, 0, 0}, Vec3d{0, 1, 0}), (Vec3d{0, 0, 1}));
  EXPECT_EQ(normalized(Vec3d{}), Vec3d{});
}

}  // namespace
}  // namespace palpate
