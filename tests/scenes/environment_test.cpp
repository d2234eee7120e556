#include "scenes/environment.h"

#include <gtest/gtest.h>

#include "scenes/truth.h"
#include "tests/test_util/random.h"

namespace palpate {
inline namespace v0 {
namespace scenes {
namespace {

using test::Random;

std::vector<Environment> all_environments() {
  std::vector<Environment> all;
  for (const std::string& name : environment_names()) all.push_back(*environment_of(name));
  all.push_back(
      Environment::box({{0.02, -0.03, 1.1}, axis_angle({1, 2, 3}, 0.7)}, {0.2, 0.1, 0.15}));
  return all;
}

bool in_solid(const Environment& e, const Vec3d& p) {
  const bool a = dot(e.a.normal, p) <= e.a.offset, b = dot(e.b.normal, p) <= e.b.offset;
  const bool ball = norm(p - e.center) <= e.radius;
  switch (e.kind) {
    case Environment::Kind::half_space: return a;
    case Environment::Kind::ridge: return a && b;
    case Environment::Kind::corner: return a || b;
    case Environment::Kind::ball_outside: return ball;
    case Environment::Kind::ball_inside: return !ball;
    case Environment::Kind::box: {
      const Vec3d q = inverse(e.X_WB) * p;
      return std::abs(q.x) <= e.half_size.x && std::abs(q.y) <= e.half_size.y &&
             std::abs(q.z) <= e.half_size.z;
    }
  }
  return false;
}

TEST(Environment, DepthOnTheAxisIsOneMeter) {
  for (const std::string& name : environment_names()) {
    EXPECT_NEAR(first_hit(*environment_of(name), {0, 0, 1}), 1, 1e-12) << name;
  }
}

TEST(Environment, SignAgreesWithMembership) {
  Random random(1);
  for (const Environment& e : all_environments()) {
    for (int i = 0; i < 2000; ++i) {
      const Vec3d p = Vec3d{0, 0, 1} + random.in_box(0.4);
      EXPECT_EQ(signed_distance(e, p).distance <= 0, in_solid(e, p));
    }
  }
}

// The foot p - d g lies on the surface, no surface point found by marching is nearer, and the
// gradient agrees with finite differences.
TEST(Environment, SignedDistanceIsTheNearestSurfacePoint) {
  Random random(2);
  for (const Environment& e : all_environments()) {
    for (int i = 0; i < 200; ++i) {
      const Vec3d p = Vec3d{0, 0, 1} + random.in_box(0.3);
      const SignedDistance d = signed_distance(e, p);
      EXPECT_NEAR(norm(d.gradient), 1, 1e-12);
      EXPECT_NEAR(signed_distance(e, p - d.distance * d.gradient).distance, 0, 1e-12);
      for (int ray = 0; ray < 20; ++ray) {
        const Vec3d q = p + random.direction() * (std::abs(d.distance) * 0.999);
        EXPECT_EQ(in_solid(e, q), in_solid(e, p));
      }
      const double h = 1e-6;
      const Vec3d direction = random.direction();
      const double slope = (signed_distance(e, p + h * direction).distance -
                            signed_distance(e, p - h * direction).distance) /
                           (2 * h);
      if (std::abs(d.distance) > 1e-4) {
        EXPECT_NEAR(slope, dot(d.gradient, direction), 2e-3);
      }
    }
  }
}

TEST(Environment, RaysEndOnTheSurfaceAndCrossItThere) {
  Random random(3);
  for (const Environment& e : all_environments()) {
    for (int i = 0; i < 500; ++i) {
      const Vec3d direction{random.uniform(-0.5, 0.5), random.uniform(-0.4, 0.4), 1};
      const double t = first_hit(e, direction);
      if (std::isnan(t)) {
        EXPECT_TRUE(e.kind == Environment::Kind::ball_outside ||
                    e.kind == Environment::Kind::ball_inside || e.kind == Environment::Kind::box);
        continue;
      }
      EXPECT_FALSE(in_solid(e, direction * (t - 1e-7)));
      EXPECT_TRUE(in_solid(e, direction * (t + 1e-7)));
      if (e.kind == Environment::Kind::ball_inside) continue;
      for (double s = 0.01; s < 1; s += 0.01) EXPECT_FALSE(in_solid(e, direction * (t * s)));
    }
  }
}

TEST(Environment, RidgeAndCornerOpenAsFarAsTheirNamesSay) {
  // Share of a small circle around the edge that lies in the solid.
  for (const auto& [name, degrees] :
       {std::pair{"ridge-135", 135.0}, std::pair{"ridge-90", 90.0}, std::pair{"corner-225", 225.0},
        std::pair{"corner-270", 270.0}}) {
    const Environment e = *environment_of(name);
    int inside = 0;
    for (int i = 0; i < 3600; ++i) {
      const double angle = 2 * kPi * (i + 0.5) / 3600;
      inside += in_solid(e, {0.1 * std::cos(angle), 0.3, 1 + 0.1 * std::sin(angle)});
    }
    EXPECT_NEAR(inside / 10.0, degrees, 0.2) << name;
  }
}

}  // namespace
}  // namespace scenes
}  // namespace v0
}  // namespace palpate
