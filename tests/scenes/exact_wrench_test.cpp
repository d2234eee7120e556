// exact_penetration against closed forms, identities, columns and differences of the energy.
#include <gtest/gtest.h>

#include "palpate/mesh/mesh.h"
#include "scenes/truth.h"
#include "tests/scenes/column_quadrature.h"
#include "tests/test_util/random.h"

namespace palpate {
inline namespace v0 {
namespace scenes {
namespace {

using test::Random;

double volume(const TriangleMesh& mesh) { return mass_properties(mesh).volume; }

double difference(const VolumeWrench& a, const VolumeWrench& b, double length) {
  return std::max(norm(a.force - b.force), norm(a.torque - b.torque) / length);
}

Environment ball(Environment::Kind kind, const Vec3d& center, double radius) {
  Environment e;
  e.kind = kind;
  e.center = center;
  e.radius = radius;
  return e;
}

TEST(ExactPenetration, VolumeIsTheExactVolume) {
  const TriangleMesh tool = make_spiral(0.02, 0.004, 0.014, 4, 24, 8);
  Random random(3);
  for (const std::string& name : environment_names()) {
    const Pose X_WT{Vec3d{0, 0, 1} + random.in_box(0.03), random.rotation(kPi)};
    const Environment e = *environment_of(name);
    EXPECT_EQ(exact_penetration(tool, X_WT, {}, e).volume, exact_volume(tool, X_WT, e));
  }
}

// If one plane is the nearest surface everywhere, the measure is V n, at the center of volume.
TEST(ExactPenetration, NextToOnePlaneTheMeasureIsVolumeTimesNormal) {
  const TriangleMesh cube = make_box({0.1, 0.1, 0.1});
  Random random(5);
  for (const char* name : {"wall", "ridge-135", "ridge-90", "corner-225", "corner-270"}) {
    const Environment e = *environment_of(name);
    for (int i = 0; i < 20; ++i) {
      // Far from the edge along plane a, and wholly behind it.
      const Vec3d along = normalized(cross(e.a.normal, {0, 1, 0}));
      const Vec3d apart = dot(along, {1, 0, 0}) > 0 ? along : -along;
      const Pose X_WT{Vec3d{0, 0, 1} + apart * 0.6 - e.a.normal * 0.15 + random.in_box(0.05),
                      random.rotation(kPi)};
      const Vec3d center = X_WT.translation + random.in_box(0.05);
      const ExactPenetration exact = exact_penetration(cube, X_WT, center, e);
      const Vec3d force = e.a.normal * volume(cube);
      const VolumeWrench expected{force, cross(X_WT.translation - center, force)};
      EXPECT_LT(difference(exact.measure_C_W, expected, 0.1), 1e-10 * volume(cube)) << name;
    }
  }
}

// Over a square of side s with a corner in the origin, x / sqrt(x^2 + y^2) integrates to
// s^2 (sqrt(2) - 1 + asinh(1)) / 2.
TEST(ExactPenetration, BehindTheEdgeOfARightCornerMatchesTheClosedForm) {
  const TriangleMesh cube = make_box({0.1, 0.1, 0.1});
  const Environment e = *environment_of("corner-270");
  const Pose X_WT{{0, 0.02, 1 + 0.1 / std::sqrt(2.0)}, axis_angle({0, 1, 0}, kPi / 4)};
  const VolumeWrench measure = exact_penetration(cube, X_WT, X_WT.translation, e).measure_C_W;
  const double side = 0.001 * (std::sqrt(2.0) - 1 + std::asinh(1.0)) / 2;
  EXPECT_LT(norm(measure.force - Vec3d{0, 0, -side * std::sqrt(2.0)}), 1e-9 * 0.001);
  EXPECT_LT(norm(measure.torque), 1e-9 * 0.0001);
  // The edge through the middle: a quarter of the cube is free, one lies behind each plane, where
  // the measure is V n, and one is as above, of half the side.
  const Pose middle{{0, 0, 1}, X_WT.rotation};
  const double along_planes = 0.00025 * std::sqrt(2.0);
  EXPECT_LT(norm(exact_penetration(cube, middle, {0, 0, 1}, e).measure_C_W.force -
                 Vec3d{0, 0, -along_planes - side * std::sqrt(2.0) / 4}),
            1e-9 * 0.001);
}

// Half a ball: the unit vectors add up to pi r^3 / 3; an eighth: to pi r^3 / 12 per axis.
TEST(ExactPenetration, SmallBallsInsideTheToolMatchClosedForms) {
  const TriangleMesh cube = make_box({0.1, 0.1, 0.1});
  Random random(7);
  for (int i = 0; i < 50; ++i) {
    const Pose X_WT{Vec3d{0, 0, 1} + random.in_box(0.1), random.rotation(kPi)};
    const double r = random.uniform(0.001, 0.02);
    const auto force_in_tool = [&](const Vec3d& center_T) {
      const Environment e = ball(Environment::Kind::ball_outside, X_WT * center_T, r);
      const VolumeWrench measure = exact_penetration(cube, X_WT, X_WT * center_T, e).measure_C_W;
      EXPECT_EQ(norm(measure.torque), 0);
      return rotate(conjugate(X_WT.rotation), measure.force) / (r * r * r);
    };
    const double eighth = kPi / 12;
    EXPECT_LT(norm(force_in_tool(random.in_box(0.03))), 1e-10);
    EXPECT_LT(norm(force_in_tool({0.05, 0.01, 0}) - Vec3d{-kPi / 3, 0, 0}), 1e-10);
    EXPECT_LT(norm(force_in_tool({0.05, -0.05, 0.05}) - Vec3d{-eighth, eighth, -eighth}), 1e-10);
  }
}

// The parts inside and outside of the ball make up the tool, for any radius.
TEST(ExactPenetration, PartsInsideAndOutsideOfABallAddUp) {
  const TriangleMesh tool = make_torus(0.05, 0.02, 16, 10);
  Random random(11);
  for (int i = 0; i < 20; ++i) {
    const Pose X_WT{Vec3d{0, 0, 1} + random.in_box(0.03), random.rotation(kPi)};
    const Vec3d center = Vec3d{0, 0, 1.2} + random.in_box(0.2);
    const auto measure = [&](Environment::Kind kind, double radius) {
      return exact_penetration(tool, X_WT, {0, 0, 1}, ball(kind, center, radius)).measure_C_W;
    };
    const VolumeWrench whole = measure(Environment::Kind::ball_outside, 10);
    for (double radius : {0.1, 0.2, 0.3}) {
      const VolumeWrench in = measure(Environment::Kind::ball_outside, radius);
      const VolumeWrench out = measure(Environment::Kind::ball_inside, radius);
      const VolumeWrench sum{in.force - out.force, in.torque - out.torque};
      EXPECT_LT(difference(sum, whole, 0.1), 1e-10 * volume(tool));
    }
  }
}

TEST(ExactPenetration, DoesNotDependOnHowFacesAreSplit) {
  const TriangleMesh box = make_box({0.1, 0.08, 0.12});
  TriangleMesh split = box;
  split.triangles.clear();
  for (const auto& [a, b, c] : box.triangles) {
    const auto middle = static_cast<std::uint32_t>(split.vertices.size());
    split.vertices.push_back((box.vertices[a] * 3 + box.vertices[b] * 2 + box.vertices[c]) / 6);
    split.triangles.insert(split.triangles.end(), {{a, b, middle}, {b, c, middle}, {c, a, middle}});
  }
  Random random(13);
  for (const std::string& name : environment_names()) {
    const Environment e = *environment_of(name);
    for (int i = 0; i < 20; ++i) {
      const Pose X_WT{Vec3d{0, 0, 1} + random.in_box(0.05), random.rotation(kPi)};
      const VolumeWrench a = exact_penetration(box, X_WT, X_WT.translation, e).measure_C_W;
      const VolumeWrench b = exact_penetration(split, X_WT, X_WT.translation, e).measure_C_W;
      EXPECT_LT(difference(a, b, 0.1), 1e-9 * volume(box)) << name;
    }
  }
}

struct Case {
  TriangleMesh tool;
  int columns;
  double tolerance;  // of the tool's volume: the quadrature's error
};

// Every kind, convex and ring-shaped tools, random poses.
TEST(ExactPenetration, MatchesColumnQuadratureInRandomPoses) {
  const Case cases[] = {{make_box({0.1, 0.08, 0.12}), 200, 4e-4},
                        {make_octahedron(0.15), 200, 4e-4},
                        {make_tetrahedron(0.15), 200, 4e-4},
                        {make_torus(0.05, 0.02, 16, 10), 150, 3e-3}};
  Random random(17);
  for (const Case& c : cases) {
    double worst = 0;
    for (const std::string& name : environment_names()) {
      const Environment e = *environment_of(name);
      for (int i = 0; i < 4; ++i) {
        const Pose X_WT{Vec3d{0, 0, 1} + random.in_box(0.06), random.rotation(kPi)};
        const Vec3d center = X_WT.translation + random.in_box(0.02);
        const double apart =
            difference(exact_penetration(c.tool, X_WT, center, e).measure_C_W,
                       test::column_wrench(c.tool, X_WT, center, e, c.columns), 0.1) /
            volume(c.tool);
        EXPECT_LT(apart, c.tolerance) << name;
        worst = std::max(worst, apart);
      }
    }
    std::printf("columns: worst difference %.1e of the tool's volume\n", worst);
  }
}

TEST(ExactPenetration, BoxesMatchColumnQuadratureAndTheRidge) {
  const TriangleMesh torus = make_torus(0.05, 0.02, 16, 10);
  Random random(29);
  for (int i = 0; i < 12; ++i) {
    const Pose X_WT{Vec3d{0, 0, 1} + random.in_box(0.03), random.rotation(kPi)};
    const Vec3d half = Vec3d{0.06, 0.06, 0.06} + random.in_box(0.03);
    const Pose X_WB{Vec3d{0, 0, 1} + random.in_box(0.06), random.rotation(kPi)};
    const Environment box = Environment::box(X_WB, half);
    const Vec3d center = X_WT.translation + random.in_box(0.02);
    EXPECT_LT(difference(exact_penetration(torus, X_WT, center, box).measure_C_W,
                         test::column_wrench(torus, X_WT, center, box, 150), 0.1),
              5e-3 * volume(torus));
    // A box so large that only two of its faces are near is a ridge.
    const Environment large =
        Environment::box(X_WB * Pose{{-3 + half.x, -3 + half.y, 0}, {}}, {3, 3, 9});
    Environment ridge;
    ridge.kind = Environment::Kind::ridge;
    ridge.a = large.faces()[1];
    ridge.b = large.faces()[3];
    EXPECT_LT(difference(exact_penetration(torus, X_WT, center, large).measure_C_W,
                         exact_penetration(torus, X_WT, center, ridge).measure_C_W, 0.1),
              1e-9 * volume(torus));
  }
}

// The difference falls with the number of columns: it is the quadrature's, not ours.
TEST(ExactPenetration, ColumnQuadratureConvergesToIt) {
  const TriangleMesh cube = make_box({0.1, 0.1, 0.1});
  const Pose X_WT{{0.01, 0.02, 1.013}, {}};
  for (const char* name : {"sphere-out-160", "sphere-in-160", "corner-225"}) {
    const Environment e = *environment_of(name);
    const VolumeWrench columns = test::column_wrench(cube, X_WT, {0, 0, 1}, e, 1000);
    EXPECT_LT(difference(exact_penetration(cube, X_WT, {0, 0, 1}, e).measure_C_W, columns, 0.1),
              1e-5 * volume(cube))
        << name;
  }
}

// Six central differences of the energy, moved along and turned about each axis through C.
TEST(ExactPenetration, IsMinusTheGradientOfTheEnergy) {
  const TriangleMesh cube = make_box({0.1, 0.1, 0.1});
  constexpr double kStep = 1e-4;
  Random random(19);
  for (const std::string& name : environment_names()) {
    const Environment e = *environment_of(name);
    const Pose X_WT{Vec3d{0, 0, 1.02} + random.in_box(0.03), random.rotation(kPi)};
    const Vec3d center = X_WT.translation + random.in_box(0.02);
    const auto energy = [&](const Pose& moved) {
      const Pose X_WM = Pose{center + moved.translation, moved.rotation} * Pose{-center, {}} * X_WT;
      return test::column_energy(cube, X_WM, e, 100);
    };
    const VolumeWrench measure = exact_penetration(cube, X_WT, center, e).measure_C_W;
    for (int axis = 0; axis < 3; ++axis) {
      Vec3d step;
      step[axis] = kStep;
      const double slope = (energy({step, {}}) - energy({-step, {}})) / (2 * kStep);
      EXPECT_NEAR(measure.force[axis], -slope, 1e-3 * volume(cube)) << name;
      const double turn =
          (energy({{}, axis_angle(step, kStep)}) - energy({{}, axis_angle(step, -kStep)})) /
          (2 * kStep);
      EXPECT_NEAR(measure.torque[axis], -turn, 1e-3 * volume(cube) * 0.1) << name;
    }
  }
}

TEST(ExactPenetration, ZeroInFreeSpace) {
  const TriangleMesh tool = make_torus(0.04, 0.015, 24, 12);
  for (const std::string& name : environment_names()) {
    const VolumeWrench measure =
        exact_penetration(tool, {{0, 0, 0.9}, {}}, {0, 0, 0.9}, *environment_of(name)).measure_C_W;
    EXPECT_LT(difference(measure, {}, 0.1), 1e-10 * volume(tool)) << name;
  }
}

}  // namespace
}  // namespace scenes
}  // namespace v0
}  // namespace palpate
