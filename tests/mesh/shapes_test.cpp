// Shapes against their closed forms.
#include "palpate/mesh/mesh.h"

#include <algorithm>
#include <cmath>

#include <gtest/gtest.h>

#include "palpate/math/geometry.h"

namespace palpate {
namespace {

double longest_side(const TriangleMesh& mesh) {
  const Bounds box = bounds(mesh);
  const Vec3d sides = box.high - box.low;
  return std::max({sides.x, sides.y, sides.z});
}

void expect_solid(const TriangleMesh& mesh, double volume) {
  const auto solid = check_solid(mesh);
  ASSERT_TRUE(solid) << solid.error().message;
  EXPECT_TRUE(solid->warnings.empty()) << solid->warnings.front();
  EXPECT_EQ(solid->mesh.triangles.size(), mesh.triangles.size());
  EXPECT_EQ(solid->mesh.vertices.size(), mesh.vertices.size());
  EXPECT_NEAR(mass_properties(mesh).volume, volume, 1e-12 * volume);
}

TEST(Shapes, PlatonicSolidsHaveTheirVolumes) {
  expect_solid(make_box({0.1, 0.2, 0.3}), 0.006);
  expect_solid(make_octahedron(0.2), 4.0 / 3 * 1e-3);
  expect_solid(make_tetrahedron(0.1), 1e-3 / (6 * std::sqrt(2.0)));
}

TEST(Shapes, TetrahedronIsRegularAndCentered) {
  const TriangleMesh mesh = make_tetrahedron(0.1);
  ASSERT_EQ(mesh.vertices.size(), 4u);
  for (int i = 0; i < 4; ++i) {
    for (int j = 0; j < i; ++j) {
      EXPECT_NEAR(norm(mesh.vertices[i] - mesh.vertices[j]), 0.1, 1e-15);
    }
  }
  EXPECT_NEAR(norm(mass_properties(mesh).center_of_mass), 0, 1e-16);
  EXPECT_GT(std::max_element(mesh.vertices.begin(), mesh.vertices.end(),
                             [](const Vec3d& a, const Vec3d& b) { return a.z < b.z; })
                ->z,
            0.06);
}

TEST(Shapes, CylinderIsARegularPrism) {
  const double area = 0.5 * 40 * 0.02 * 0.02 * std::sin(2 * kPi / 40);
  expect_solid(make_cylinder(0.02, 0.1, 40), area * 0.1);
}

TEST(Shapes, StylusIsPrismAndPyramidWithTheTipDown) {
  const double area = 0.5 * 24 * 0.005 * 0.005 * std::sin(2 * kPi / 24);
  const TriangleMesh mesh = make_stylus(0.005, 0.15, 0.03, 24);
  expect_solid(mesh, area * (0.12 + 0.03 / 3));
  const auto tip = std::min_element(mesh.vertices.begin(), mesh.vertices.end(),
                                    [](const Vec3d& a, const Vec3d& b) { return a.z < b.z; });
  EXPECT_EQ(tip->x, 0);
  EXPECT_EQ(tip->y, 0);
  EXPECT_DOUBLE_EQ(tip->z, -0.075);
  EXPECT_DOUBLE_EQ(bounds(mesh).high.z, 0.075);
}

TEST(Shapes, IcosphereConvergesToTheBall) {
  double previous = 1;
  for (int level = 0; level <= 5; ++level) {
    const TriangleMesh mesh = make_icosphere(0.1, level);
    EXPECT_EQ(mesh.triangles.size(), 20u << (2 * level));
    const double missing = 1 - mass_properties(mesh).volume / sphere_volume(0.1);
    EXPECT_GT(missing, 0);
    if (level > 1) {
      EXPECT_NEAR(missing / previous, 0.25, 0.02) << level;
    }
    previous = missing;
    for (const Vec3d& p : mesh.vertices) EXPECT_NEAR(norm(p), 0.1, 1e-15);
    EXPECT_TRUE(check_solid(mesh));
  }
}

TEST(Shapes, TorusAndSpiralConvergeToPappus) {
  const TriangleMesh torus = make_torus(0.05, 0.02, 200, 100);
  const double torus_volume = 2 * kPi * 0.05 * kPi * 0.02 * 0.02;
  EXPECT_NEAR(mass_properties(torus).volume / torus_volume, 1, 2e-3);
  EXPECT_TRUE(check_solid(torus));

  const TriangleMesh spiral = make_spiral(0.02, 0.004, 0.014, 4, 100, 50);
  const double wire_length = 4 * std::hypot(2 * kPi * 0.02, 0.014);
  EXPECT_NEAR(mass_properties(spiral).volume / (wire_length * kPi * 0.004 * 0.004), 1, 4e-3);
  const auto solid = check_solid(spiral);
  EXPECT_TRUE(solid) << solid.error().message;
  EXPECT_TRUE(solid->warnings.empty());
}

// Between two rectangles with parallel sides and flat walls: the prismatoid formula of Simpson.
TEST(Shapes, BarIsAStackOfPrismatoids) {
  expect_solid(make_bar({{0, 0.03, 0.02}, {0.05, 0.03, 0.02}}), 0.03 * 0.02 * 0.05);
  const TriangleMesh mesh = make_bar({{0, 0.02, 0.03}, {0.1, 0.01, 0.05}, {0.15, 0.001, 0.002}});
  const double lower = 0.1 / 6 * (0.02 * 0.03 + 4 * 0.015 * 0.04 + 0.01 * 0.05);
  const double upper = 0.05 / 6 * (0.01 * 0.05 + 4 * 0.0055 * 0.026 + 0.001 * 0.002);
  expect_solid(mesh, lower + upper);
  EXPECT_DOUBLE_EQ(bounds(mesh).low.z, -0.075);
}

TEST(Shapes, CombIsABackWithTrapezia) {
  const TriangleMesh mesh = make_comb(5, 0.01, 0.006, 0.001, 0.04, 0.012, 0.003);
  expect_solid(mesh, 0.003 * (0.046 * 0.012 + 5 * 0.04 * (0.006 + 0.001) / 2));
  const Bounds box = bounds(mesh);
  EXPECT_NEAR(box.high.x, 0.023, 1e-15);
  EXPECT_NEAR(box.low.z, -0.026, 1e-15);
  expect_solid(make_comb(1, 0.01, 0.006, 0.001, 0.04, 0.012, 0.003),
               0.003 * (0.006 * 0.012 + 0.04 * 0.0035));
}

// Thinner than a hundredth of their length at the end that touches, where they may be felt least.
TEST(Shapes, FingerCombNeedleAndBladeAreThinAtOneEnd) {
  for (const char* name : {"finger", "comb", "needle", "blade"}) {
    SCOPED_TRACE(name);
    const TriangleMesh mesh = make_shape(name, 0.196).value();
    const Bounds box = bounds(mesh);
    const double end = std::string_view(name) == "finger" ? box.high.z : box.low.z;
    double least[2] = {1, 1}, most[2] = {-1, -1};
    for (const Vec3d& p : mesh.vertices) {
      if (std::abs(p.z - end) > 1e-9) continue;
      // One tooth of the comb is enough.
      if (std::string_view(name) == "comb" && p.x > box.low.x + 0.01) continue;
      for (int axis = 0; axis < 2; ++axis) {
        least[axis] = std::min(least[axis], p[axis]);
        most[axis] = std::max(most[axis], p[axis]);
      }
    }
    EXPECT_LT(std::min(most[0] - least[0], most[1] - least[1]), 0.00196 / 2);
  }
}

TEST(Shapes, EveryNameGivesASolidOfTheSizeAroundTheOrigin) {
  const auto names = shape_names();
  EXPECT_EQ(names.size(), 12u);
  for (const std::string& name : names) {
    SCOPED_TRACE(name);
    const auto mesh = make_shape(name, 0.1);
    ASSERT_TRUE(mesh);
    EXPECT_NEAR(longest_side(*mesh), 0.1, 1e-15);
    const auto solid = check_solid(*mesh);
    ASSERT_TRUE(solid) << solid.error().message;
    EXPECT_TRUE(solid->warnings.empty());
    const Bounds box = bounds(*mesh);
    for (int axis = 0; axis < 3; ++axis) {
      EXPECT_LE(box.low[axis], 0);
      EXPECT_GE(box.high[axis], 0);
    }
  }
}

TEST(Shapes, SpiralLooksLikeTheOneOfTheThesis) {
  const auto mesh = make_shape("spiral", 0.064);
  const Bounds box = bounds(*mesh);
  EXPECT_NEAR(box.high.x - box.low.x, 0.048, 0.001);
  EXPECT_NEAR(box.high.y - box.low.y, 0.048, 0.001);
}

TEST(Shapes, BadNamesAndSizesAreErrors) {
  const auto unknown = make_shape("teapot", 0.1);
  ASSERT_FALSE(unknown);
  EXPECT_EQ(unknown.error().code, Errc::not_found);
  EXPECT_NE(unknown.error().message.find("octahedron"), std::string::npos);
  for (const double size : {0.0, -1.0, std::nan(""), HUGE_VAL}) {
    EXPECT_EQ(make_shape("box", size).error().code, Errc::invalid_argument);
  }
}

}  // namespace
}  // namespace palpate
