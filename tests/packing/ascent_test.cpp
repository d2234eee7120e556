#include "src/packing/ascent.h"

#include <limits>

#include <gtest/gtest.h>

#include "palpate/mesh/mesh.h"
#include "src/packing/hole_search.h"
#include "tests/test_util/random.h"

namespace palpate {
namespace {

constexpr double kInfinity = std::numeric_limits<double>::infinity();

TEST(Ascent, FindsTheInscribedBall) {
  test::Random random(5);
  const SphereLevels none;
  const TriangleBvh octahedron(make_octahedron(2)), tetrahedron(make_tetrahedron(1));
  for (const auto& [mesh, inscribed] :
       {std::pair{&octahedron, 1 / std::sqrt(3.0)}, std::pair{&tetrahedron, 1 / std::sqrt(24.0)}}) {
    const FreeSpace space{*mesh, none, kInfinity};
    Ascent ascent(space);
    for (int i = 0; i < 100; ++i) {
      const Vec3d p = random.in_box(0.15);
      if (!mesh->inside(p)) continue;
      EXPECT_NEAR(ascent.climb(p, 10).radius, inscribed, 1e-9);
    }
  }
}

// Four mutually touching unit balls leave room for one of radius sqrt(3/2) - 1 (Descartes).
TEST(Ascent, ConvergesToTheApolloniusBall) {
  const TriangleBvh mesh(make_box({20, 20, 20}));
  SphereLevels spheres;
  const float a = static_cast<float>(std::sqrt(0.5));
  for (const Vec3f& c : {Vec3f{a, a, a}, Vec3f{a, -a, -a}, Vec3f{-a, a, -a}, Vec3f{-a, -a, a}}) {
    spheres.insert({c, 1});
  }
  const FreeSpace space{mesh, spheres, kInfinity};
  Ascent ascent(space);
  test::Random random(6);
  for (int i = 0; i < 100; ++i) {
    const Vec3d start = random.in_box(0.1);
    const Ball ball = ascent.climb(start, 10);
    EXPECT_NEAR(ball.radius, std::sqrt(1.5) - 1, 1e-6);
    EXPECT_NEAR(norm(ball.center), 0, 1e-6);
    EXPECT_DOUBLE_EQ(ball.radius, space.clearance(ball.center, 10));
  }
}

// In a cone the clearance grows away from the tip.
TEST(Ascent, StaysOnItsTether) {
  const TriangleBvh mesh(make_stylus(0.1, 1, 0.9, 24));
  const SphereLevels none;
  const FreeSpace space{mesh, none, kInfinity};
  Ascent ascent(space);
  const Vec3d tip{0, 0, -0.5}, start{0, 0, -0.4};
  EXPECT_GT(norm(ascent.climb(start, 1).center - tip), 0.3);
  for (const double length : {0.1, 0.11, 0.15}) {
    const Ascent::Tether tether{tip, length};
    const Ball ball = ascent.climb(start, 1, &tether);
    const double away = norm(ball.center - tip) - ball.radius;
    EXPECT_LE(away, length);
    EXPECT_GT(away, length - 2 * ball.radius);  // a step is shorter than the ball is wide
    EXPECT_DOUBLE_EQ(ball.radius, space.clearance(ball.center, 1));
  }
  const Ascent::Tether none_left{tip, 0.05};
  EXPECT_EQ(ascent.climb(start, 1, &none_left).center, start);
}

TEST(Ascent, NeverLosesClearanceAndStaysInside) {
  const TriangleBvh mesh(make_shape("spiral", 1).value());
  const SphereLevels none;
  const FreeSpace space{mesh, none, kInfinity};
  Ascent ascent(space);
  test::Random random(7);
  for (int i = 0; i < 3000; ++i) {
    const Vec3d p = random.in_box(0.5);
    if (!mesh.inside(p)) continue;
    const double before = space.clearance(p, 10);
    const Ball ball = ascent.climb(p, 10);
    EXPECT_GE(ball.radius, before);
    EXPECT_NEAR(ball.radius, space.clearance(ball.center, 10), 2e-3 * ball.radius);
    EXPECT_TRUE(mesh.inside(ball.center));
  }
}

TEST(Ascent, StopsAtTheLargestRadiusWanted) {
  const TriangleBvh mesh(make_box({2, 2, 2}));
  const SphereLevels none;
  const FreeSpace space{mesh, none, 0.25};
  EXPECT_EQ(Ascent(space).climb({0.9, 0.9, 0.9}, 10).radius, 0.25);
}

// The ball of a cube leaves eight equal corners; the largest ball in a corner touches it on the
// diagonal: r = (sqrt3 - 1) / (sqrt3 + 1) for half side 1.
TEST(HoleSearch, FindsTheCornersOfACube) {
  const TriangleBvh mesh(make_box({2, 2, 2}));
  SphereLevels spheres;
  const Sphere ball{{0, 0, 0}, std::nextafter(1.0f, 0.0f)};
  spheres.insert(ball);
  const FreeSpace space{mesh, spheres, kInfinity};
  std::vector<Ball> holes;
  HoleSearch(space).find(ball, 1e-3, holes);
  ASSERT_EQ(holes.size(), 8u);
  const double expected = (std::sqrt(3.0) - 1) / (std::sqrt(3.0) + 1);
  for (const Ball& hole : holes) EXPECT_NEAR(hole.radius, expected, 1e-6);
}

TEST(TangentBall, TouchesTheOppositeWall) {
  const TriangleBvh mesh(make_box({1, 1, 0.01}));
  const SphereLevels none;
  const FreeSpace space{mesh, none, kInfinity};
  const Ball ball = space.tangent_ball({0.1, 0.2, -0.005}, {0, 0, 1}, 3);
  EXPECT_NEAR(ball.radius, 0.005, 2e-5);
  EXPECT_EQ(space.tangent_ball({0.1, 0.2, -0.005}, {0, 0, -1}, 3).radius, 0);
}

}  // namespace
}  // namespace palpate
