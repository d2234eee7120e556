#include "scenes/truth.h"

#include <gtest/gtest.h>

#include "palpate/mesh/mesh.h"
#include "tests/scenes/column_quadrature.h"
#include "tests/test_util/random.h"

namespace palpate {
inline namespace v0 {
namespace scenes {
namespace {

using test::column_volume;
using test::Random;

double volume(const TriangleMesh& mesh) { return mass_properties(mesh).volume; }

Environment flipped(const Environment& e) {
  Environment other = e;
  other.a = {-e.a.normal, -e.a.offset};
  other.b = {-e.b.normal, -e.b.offset};
  switch (e.kind) {
    case Environment::Kind::half_space: break;
    case Environment::Kind::ridge: other.kind = Environment::Kind::corner; break;
    case Environment::Kind::corner: other.kind = Environment::Kind::ridge; break;
    case Environment::Kind::ball_outside: other.kind = Environment::Kind::ball_inside; break;
    case Environment::Kind::ball_inside: other.kind = Environment::Kind::ball_outside; break;
    case Environment::Kind::box: break;  // has no complement here
  }
  return other;
}

/// Volume share of a tool of length `length` along z that has gone a share s of its length into the
/// wall.
double wall_share(const TriangleMesh& tool, const Quaternion& rotation, double front, double length,
                  double s) {
  const Pose X_WT{{0.03, -0.02, 1 - front + s * length}, rotation};
  return exact_volume(tool, X_WT, Environment::wall(1)) / volume(tool);
}

// Closed forms of theory: cube s; octahedron 4s^3, 1-4(1-s)^3; tetrahedron s^3 vertex first,
// 1-(1-s)^3 face first, 3s^2-2s^3 edge first.
TEST(ExactVolume, MatchesClosedFormsAtTheWall) {
  const Quaternion ahead = {}, turned_over = axis_angle({1, 0, 0}, kPi);
  const Quaternion edge_first =
      axis_angle({0, 1, 0}, std::atan2(std::sqrt(2.0 / 3.0), -std::sqrt(1.0 / 3.0)));
  const double h = 0.15 * std::sqrt(2.0 / 3.0);
  for (int i = 0; i <= 100; ++i) {
    const double s = i / 100.0, r = 1 - s;
    EXPECT_NEAR(wall_share(make_box({0.1, 0.1, 0.1}), ahead, 0.05, 0.1, s), s, 1e-12);
    EXPECT_NEAR(wall_share(make_octahedron(0.15), ahead, 0.075, 0.15, s),
                s < 0.5 ? 4 * s * s * s : 1 - 4 * r * r * r, 1e-12);
    const TriangleMesh tetrahedron = make_tetrahedron(0.15);
    EXPECT_NEAR(wall_share(tetrahedron, ahead, 0.75 * h, h, s), s * s * s, 1e-12);
    EXPECT_NEAR(wall_share(tetrahedron, turned_over, 0.25 * h, h, s), 1 - r * r * r, 1e-12);
    EXPECT_NEAR(
        wall_share(tetrahedron, edge_first, 0.15 / std::sqrt(8.0), 0.15 / std::sqrt(2.0), s),
        3 * s * s - 2 * s * s * s, 1e-12);
  }
}

TEST(ExactVolume, WholeOrNothingFarFromTheSurface) {
  const TriangleMesh tool = make_torus(0.04, 0.015, 24, 12);
  for (const std::string& name : environment_names()) {
    const Environment e = *environment_of(name);
    EXPECT_NEAR(exact_volume(tool, {{0, 0, 0.9}, {}}, e), 0, 1e-10 * volume(tool)) << name;
    EXPECT_NEAR(exact_volume(tool, {{0, 0, 1.15}, {}}, e) / volume(tool), 1, 1e-10) << name;
  }
}

// Every kind, convex and ring-shaped tools, random poses, against thin columns. The tolerance is
// the quadrature's.
TEST(ExactVolume, MatchesColumnQuadratureInRandomPoses) {
  struct Tool {
    TriangleMesh mesh;
    int columns;
    double tolerance;
  };
  const Tool tools[] = {{make_box({0.1, 0.08, 0.12}), 300, 2e-4},
                        {make_octahedron(0.15), 300, 2e-4},
                        {make_tetrahedron(0.15), 300, 2e-4},
                        {make_torus(0.05, 0.02, 16, 10), 120, 2e-3}};
  Random random(7);
  for (const Tool& tool : tools) {
    for (const std::string& name : environment_names()) {
      for (int i = 0; i < 4; ++i) {
        const Pose X_WT{Vec3d{0, 0, 1} + random.in_box(0.06), random.rotation(kPi)};
        const Environment e = *environment_of(name);
        EXPECT_NEAR(exact_volume(tool.mesh, X_WT, e) / volume(tool.mesh),
                    column_volume(tool.mesh, X_WT, e, tool.columns) / volume(tool.mesh),
                    tool.tolerance)
            << name;
      }
    }
  }
}

// With n columns the difference falls like n^-2: it is the quadrature's, not ours.
TEST(ExactVolume, QuadratureOfACubeInABallConvergesToIt) {
  const TriangleMesh cube = make_box({0.1, 0.1, 0.1});
  const Pose X_WT{{0.01, 0.02, 1.013}, {}};
  const Environment e = *environment_of("sphere-out-160");
  const double exact = exact_volume(cube, X_WT, e);
  EXPECT_LT(std::abs(column_volume(cube, X_WT, e, 1500) - exact) / volume(cube), 1e-6);
}

TEST(ExactVolume, SmallBallsInsideTheToolAreWhole) {
  const TriangleMesh cube = make_box({0.1, 0.1, 0.1});
  Random random(5);
  for (int i = 0; i < 50; ++i) {
    Environment e;
    e.kind = Environment::Kind::ball_outside;
    const Pose X_WT{Vec3d{0, 0, 1} + random.in_box(0.1), random.rotation(kPi)};
    e.center = X_WT * random.in_box(0.03);
    e.radius = random.uniform(0.001, 0.02);
    EXPECT_NEAR(exact_volume(cube, X_WT, e) / sphere_volume(e.radius), 1, 1e-10);
    e.center = X_WT * Vec3d{0.05, 0.01, 0};  // half of it sticks out of a face
    EXPECT_NEAR(exact_volume(cube, X_WT, e) / sphere_volume(e.radius), 0.5, 1e-10);
    e.center = X_WT * Vec3d{0.05, -0.05, 0.05};  // an eighth at a corner
    EXPECT_NEAR(exact_volume(cube, X_WT, e) / sphere_volume(e.radius), 0.125, 1e-10);
  }
}

TEST(ExactVolume, SolidAndComplementAddUpToTheTool) {
  const TriangleMesh tool = make_spiral(0.02, 0.004, 0.014, 4, 24, 8);
  Random random(11);
  for (const std::string& name : environment_names()) {
    const Environment e = *environment_of(name);
    for (int i = 0; i < 20; ++i) {
      const Pose X_WT{Vec3d{0, 0, 1} + random.in_box(0.03), random.rotation(kPi)};
      const double sum = exact_volume(tool, X_WT, e) + exact_volume(tool, X_WT, flipped(e));
      EXPECT_NEAR(sum / volume(tool), 1, 1e-10) << name;
    }
  }
}

// Boxes of any size around a tool, next to it and within it.
TEST(ExactVolume, BoxesMatchColumnQuadratureAndProducts) {
  Random random(17);
  const TriangleMesh torus = make_torus(0.05, 0.02, 16, 10), cube = make_box({0.1, 0.1, 0.1});
  for (int i = 0; i < 20; ++i) {
    const Pose X_WT{Vec3d{0, 0, 1} + random.in_box(0.03), random.rotation(kPi)};
    const Vec3d half = Vec3d{0.06, 0.06, 0.06} + random.in_box(0.05);
    const Environment e =
        Environment::box({Vec3d{0, 0, 1} + random.in_box(0.06), random.rotation(kPi)}, half);
    EXPECT_NEAR(exact_volume(torus, X_WT, e) / volume(torus),
                column_volume(torus, X_WT, e, 120) / volume(torus), 2e-3);
    // Side by side: what two boxes share is a box.
    const Vec3d apart = random.in_box(0.1);
    double shared = 1;
    for (std::size_t k = 0; k < 3; ++k) {
      shared *=
          std::max(0.0, std::min(half[k], apart[k] + 0.05) - std::max(-half[k], apart[k] - 0.05));
    }
    EXPECT_NEAR(exact_volume(cube, e.X_WB * Pose{apart, {}}, e), shared, 1e-12 * volume(cube));
  }
}

TEST(ExactVolume, CornerIsTheUnionOfItsWalls) {
  const TriangleMesh tool = make_torus(0.05, 0.02, 16, 10);
  Random random(13);
  Environment corner = *environment_of("corner-270");
  Environment a = corner, b = corner, both = corner;
  a.kind = b.kind = Environment::Kind::half_space;
  b.a = corner.b;
  both.kind = Environment::Kind::ridge;
  for (int i = 0; i < 20; ++i) {
    const Pose X_WT{Vec3d{0, 0, 1} + random.in_box(0.05), random.rotation(kPi)};
    EXPECT_NEAR(exact_volume(tool, X_WT, corner) / volume(tool),
                (exact_volume(tool, X_WT, a) + exact_volume(tool, X_WT, b) -
                 exact_volume(tool, X_WT, both)) /
                    volume(tool),
                1e-10);
  }
}

TEST(ExactVolume, BehindThreeSlantedPlanesItAddsUpToTheTool) {
  // The eight parts of space between three planes through a point.
  Random random(5);
  const TriangleMesh tool = make_torus(0.05, 0.02, 16, 10);
  for (int i = 0; i < 50; ++i) {
    const Vec3d apex = random.in_box(0.03);
    const Pose X_WT{random.in_box(0.02), random.rotation(kPi)};
    const Vec3d normals[] = {random.direction(), random.direction(), random.direction()};
    double sum = 0;
    for (int part = 0; part < 8; ++part) {
      std::vector<Plane<double>> planes;
      for (int k = 0; k < 3; ++k) {
        const Vec3d n = (part >> k & 1) != 0 ? -normals[k] : normals[k];
        planes.push_back({n, dot(n, apex)});
      }
      const double in_part = exact_volume(tool, X_WT, apex, planes);
      EXPECT_GE(in_part, -1e-10 * volume(tool));
      sum += in_part;
      // Two of them are a ridge.
      if (part != 0) continue;
      Environment ridge;
      ridge.kind = Environment::Kind::ridge;
      ridge.a = planes[0], ridge.b = planes[1];
      std::vector<Plane<double>> other = planes;
      other[2] = {-planes[2].normal, -planes[2].offset};
      EXPECT_NEAR(in_part + exact_volume(tool, X_WT, apex, other), exact_volume(tool, X_WT, ridge),
                  1e-10 * volume(tool));
    }
    EXPECT_NEAR(sum / volume(tool), 1, 1e-10);
  }
}

TEST(ExactVolume, TurningToolAndBallTogetherChangesNothing) {
  const TriangleMesh tool = make_tetrahedron(0.15);
  Random random(17);
  const Environment e = *environment_of("sphere-out-320");
  for (int i = 0; i < 20; ++i) {
    const Pose X_WT{Vec3d{0, 0, 1} + random.in_box(0.05), random.rotation(kPi)};
    const Pose about_center = Pose{e.center, random.rotation(kPi)} * Pose{-e.center, {}};
    EXPECT_NEAR(exact_volume(tool, about_center * X_WT, e) / volume(tool),
                exact_volume(tool, X_WT, e) / volume(tool), 1e-10);
  }
}

TEST(ThesisExperiments, GoFromFirstContactToWhollyPast) {
  const std::vector<ThesisExperiment> experiments = thesis_experiments();
  EXPECT_EQ(experiments.size(), 12u);
  for (const ThesisExperiment& x : experiments) {
    SCOPED_TRACE(x.figure + " " + x.scene);
    const auto e = environment_of(x.scene);
    ASSERT_TRUE(e);
    const auto tool = make_shape(x.tool_shape, x.tool_size);
    ASSERT_TRUE(tool);
    const double whole = volume(*tool);
    EXPECT_NEAR(exact_volume(*tool, x.start, *e) / whole, 0, 1e-10);
    EXPECT_GT(exact_volume(*tool, interpolate(x.start, x.end, 0.02), *e) / whole, 1e-7);
    double rear = 10, before = -1;
    for (const Vec3d& p : tool->vertices) rear = std::min(rear, (x.end * p).z);
    EXPECT_NEAR(rear, 1, 1e-12);
    EXPECT_EQ(x.start.rotation, x.end.rotation);
    EXPECT_EQ(x.start.translation.x, x.end.translation.x);
    EXPECT_EQ(x.start.translation.y, x.end.translation.y);
    for (int i = 0; i <= 50; ++i) {
      const double v = exact_volume(*tool, interpolate(x.start, x.end, i / 50.0), *e) / whole;
      EXPECT_GT(v, before - 1e-12);
      before = v;
    }
    // A tool as wide as a ridge or ball never goes in wholly; concave solids swallow it.
    const bool concave =
        e->kind != Environment::Kind::ridge && e->kind != Environment::Kind::ball_outside;
    if (concave) {
      EXPECT_NEAR(before, 1, 1e-9);
    } else {
      EXPECT_GT(before, 0.4);
    }
  }
}

TEST(ThesisExperiments, UnknownScenesHaveNoEnvironment) {
  EXPECT_FALSE(environment_of("hand"));
  EXPECT_FALSE(environment_of(""));
}

}  // namespace
}  // namespace scenes
}  // namespace v0
}  // namespace palpate
