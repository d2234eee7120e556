// Rotation vectors there and back, and wrenches whose power does not depend on point and axes.
#include "src/math/internal/rotation_vector.h"

#include <gtest/gtest.h>

#include <cmath>

#include "src/math/internal/wrench_transform.h"
#include "tests/test_util/random.h"

namespace palpate {
namespace {

TEST(RotationVector, ThereAndBack) {
  test::Random random(1);
  for (const double length : {0.0, 1e-12, 1e-6, 0.1, 1.0, 3.1}) {
    for (int n = 0; n < 50; ++n) {
      const Vec3d turn = length * random.direction();
      const Quaternion q = rotation_by(turn);
      EXPECT_LT(norm(rotation_vector(q) - turn), 1e-14 + 1e-14 * length);
      EXPECT_LT(norm(rotation_vector({-q.x, -q.y, -q.z, -q.w}) - turn), 1e-14 + 1e-14 * length);
    }
  }
}

TEST(RotationVector, LeadsFromOneRotationToTheOther) {
  test::Random random(2);
  for (int n = 0; n < 100; ++n) {
    const Quaternion from = random.rotation(kPi), to = random.rotation(kPi);
    const Quaternion got = rotation_by(rotation_between(from, to)) * from;
    const Vec3d v = random.in_box(1);
    EXPECT_LT(norm(rotate(got, v) - rotate(to, v)), 1e-13);
  }
}

TEST(WrenchTransform, KeepsThePower) {
  test::Random random(3);
  for (int n = 0; n < 100; ++n) {
    const Pose X_WA{random.in_box(1), random.rotation(kPi)};
    const Vec3d p_W = random.in_box(1);
    const Wrench F_p_W{random.in_box(1), random.in_box(1)};
    const Vec3d turning_W = random.in_box(1), velocity_p_W = random.in_box(1);
    const Vec3d velocity_A_W = velocity_p_W + cross(turning_W, X_WA.translation - p_W);
    const Wrench F_A = transformed_to(X_WA, F_p_W, p_W);
    const double power_A = dot(F_A.force, rotate(conjugate(X_WA.rotation), velocity_A_W)) +
                           dot(F_A.torque, rotate(conjugate(X_WA.rotation), turning_W));
    EXPECT_NEAR(power_A, dot(F_p_W.force, velocity_p_W) + dot(F_p_W.torque, turning_W), 1e-13);
  }
}

}  // namespace
}  // namespace palpate
