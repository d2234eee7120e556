#include "src/session/probing/lead_end.h"

#include <gtest/gtest.h>

#include <cmath>

#include "tests/session/packed_tool.h"

namespace palpate {
namespace {

using test::moved;
using test::packed_tool;

/// A cone of 6 cm width and 12 cm height, its apex at +z; it is a stylus that is nearly all tip,
/// upside down.
TriangleMesh cone() { return moved(make_stylus(0.03, 0.1201, 0.12, 32), {{}, {1, 0, 0, 0}}); }

double cosine(const Tool& tool, const Vec3d& expected_T) {
  return dot(thinnest_end(tool).direction_T, normalized(expected_T));
}

TEST(LeadEnd, AConeLeadsWithItsApex) {
  const Tool tool = packed_tool(cone());
  EXPECT_NEAR(cosine(tool, {0, 0, 1}), 1, 1e-9);
  const LeadEnd lead = thinnest_end(tool);
  EXPECT_LT(norm(lead.tip_T - Vec3d{0, 0, 0.06}), 0.012);  // spheres do not reach into the apex
}

TEST(LeadEnd, AConeInAnyAttitudeLeadsWithItsApex) {
  for (const Vec3d& axis : {Vec3d{1, 0, 0}, Vec3d{0, 1, 0}, Vec3d{1, 2, 0.5}}) {
    for (const double angle : {0.7, 1.5708, 2.5}) {
      const Pose X{{0.05, -0.02, 0.3}, axis_angle(axis, angle)};
      const Tool tool = packed_tool(moved(make_stylus(0.02, 0.1201, 0.12, 32), X));
      EXPECT_GT(cosine(tool, rotate(X.rotation, {0, 0, -1})), 0.98) << axis.x << " " << angle;
    }
  }
}

TEST(LeadEnd, AStylusLeadsWithItsTip) {
  EXPECT_NEAR(cosine(packed_tool(make_stylus(0.006, 0.15, 0.03, 24)), {0, 0, -1}), 1, 1e-9);
}

TEST(LeadEnd, ALongToolLeadsWithAnEnd) {
  const Vec3d lead = thinnest_end(packed_tool(make_box({0.02, 0.2, 0.02}))).direction_T;
  EXPECT_NEAR(std::abs(lead.y), 1, 1e-9);
}

TEST(LeadEnd, TheThinnerEndOfALongTool) {
  // A rod of 20 cm along x that is thicker at its lower end.
  TriangleMesh rod = moved(make_stylus(0.02, 0.2, 0.199, 24), {{}, axis_angle({0, 1, 0}, kPi / 2)});
  EXPECT_NEAR(cosine(packed_tool(rod), {-1, 0, 0}), 1, 1e-9);
}

TEST(LeadEnd, EqualEndsGoByTheirOrder) {
  for (const TriangleMesh& mesh : {make_box({0.1, 0.1, 0.1}), make_icosphere(0.05, 3),
                                   make_octahedron(0.1), make_cylinder(0.01, 0.1, 24)}) {
    const Tool tool = packed_tool(mesh);
    EXPECT_NEAR(cosine(tool, {0, 0, -1}), 1, 1e-9);
    EXPECT_EQ(thinnest_end(tool).direction_T, thinnest_end(packed_tool(mesh)).direction_T);
  }
}

TEST(LeadEnd, APointOfTheToolChooses) {
  const Tool tool = packed_tool(cone());
  const auto base = end_at(tool, {0, 0, -0.06});
  ASSERT_TRUE(base) << base.error().message;
  EXPECT_LT(base->direction_T.z, -0.99);
  EXPECT_EQ(base->tip_T, (Vec3d{0, 0, -0.06}));
  ASSERT_TRUE(end_at(tool, {0, 0, 0.061}));  // the apex itself, beyond all spheres
  const auto far = end_at(tool, {0, 0, 0.2});
  ASSERT_FALSE(far);
  EXPECT_NE(far.error().message.find("in meters in the frame of its mesh"), std::string::npos);
  EXPECT_FALSE(end_at(tool, {0, 0, NAN}));
  const auto center = end_at(tool, tool.sphere_mass().center_of_mass);
  ASSERT_FALSE(center);
  EXPECT_NE(center.error().message.find("center of mass"), std::string::npos);
}

}  // namespace
}  // namespace palpate
