// The exact cube is found again in a depth image of it.
#include "eval/studies/real_cube.h"

#include <gtest/gtest.h>

#include "scenes/environment.h"
#include "src/math/internal/rotation_vector.h"
#include "tests/eval/noisy_picture.h"

namespace palpate::eval {
namespace {

constexpr double kHalf = 0.0425;  // m

/// A cube in front of a wall.
DepthFrame picture(const DepthStreamInfo& stream, const Pose& X_CB) {
  const auto cube = scenes::Environment::box(X_CB, {kHalf, kHalf, kHalf});
  return noisy_picture(stream, [&](int, int, const Vec3d& ray) {
    const double z = scenes::first_hit(cube, ray);
    return std::isnan(z) ? 0.9 : z;
  });
}

DepthStreamInfo camera() { return made_up_camera(640, 480, 600); }

TEST(RealCube, RaysHitWhereTheClosedFormSays) {
  Random random(1);
  for (int i = 0; i < 5000; ++i) {
    const Pose X_CB{Vec3d{0, 0, 0.5} + random.in_box(0.05), random.rotation(kPi)};
    const Vec3d ray{random.uniform(-0.2, 0.2), random.uniform(-0.2, 0.2), 1};
    const auto cube = scenes::Environment::box(X_CB, {kHalf, kHalf, kHalf});
    const double z = scenes::first_hit(cube, ray);
    const auto hit = hit_cube(X_CB, kHalf, ray);
    ASSERT_EQ(hit.has_value(), !std::isnan(z));
    if (!hit) continue;
    EXPECT_NEAR(hit->z, z, 1e-12);
    const Vec3d normal = cube.faces()[static_cast<std::size_t>(hit->face)].normal;
    EXPECT_NEAR(hit->slant, -dot(normal, ray) / norm(ray), 1e-9);
    // As far from the next edge as from the nearest of the other faces.
    const Vec3d p = inverse(X_CB) * (z * ray);
    double border = 1;
    for (std::size_t axis = 0; axis < 3; ++axis) {
      if (static_cast<int>(axis) != hit->face / 2)
        border = std::min(border, kHalf - std::abs(p[axis]));
    }
    EXPECT_NEAR(hit->border, border, 1e-12);
  }
}

TEST(RealCube, IsFoundAgainFromAGuessTwoCentimetersOff) {
  const DepthStreamInfo stream = camera();
  Random random(2);
  for (int i = 0; i < 6; ++i) {
    // Two faces and, more or less, the top.
    const Quaternion upright = axis_angle({1, 0, 0}, random.uniform(0.1, 0.6)) *
                               axis_angle({0, 1, 0}, random.uniform(0.5, 1.1));
    const Pose truth{Vec3d{0, 0, 0.5} + random.in_box(0.04), upright};
    Pose X_CB{truth.translation + 0.012 * random.direction(),
              normalized(random.rotation(0.05) * truth.rotation)};
    ASSERT_TRUE(lay_on(stream, picture(stream, truth), kHalf, X_CB));
    EXPECT_LT(norm(X_CB.translation - truth.translation), 1e-3);
    EXPECT_LT(norm(rotation_between(truth.rotation, X_CB.rotation)), 0.01);
  }
}

TEST(RealCube, IsNotFoundWhereItIsNotSeen) {
  DepthStreamInfo stream = camera();
  DepthFrame frame{stream.width, stream.height, stream.unit, {}, 0};
  frame.pixels.assign(640 * 480, 0);
  Pose X_CB{{0, 0, 0.5}, {}};
  EXPECT_FALSE(lay_on(stream, frame, kHalf, X_CB));
}

}  // namespace
}  // namespace palpate::eval
