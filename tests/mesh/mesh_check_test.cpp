// check_solid: what it accepts, what it repairs with a warning, and what it refuses.
#include "palpate/mesh/mesh.h"

#include <cmath>
#include <cstdint>
#include <limits>

#include <gtest/gtest.h>

#include "palpate/math/geometry.h"

namespace palpate {
namespace {

using Triangle = std::array<std::uint32_t, 3>;

TriangleMesh rotated(TriangleMesh mesh) {
  for (Triangle& t : mesh.triangles) std::swap(t[1], t[2]);
  return mesh;
}

TriangleMesh shifted(TriangleMesh mesh, const Vec3d& by) {
  for (Vec3d& p : mesh.vertices) p += by;
  return mesh;
}

TriangleMesh joined(TriangleMesh mesh, const TriangleMesh& other) {
  const auto first = static_cast<std::uint32_t>(mesh.vertices.size());
  mesh.vertices.insert(mesh.vertices.end(), other.vertices.begin(), other.vertices.end());
  for (const Triangle& t : other.triangles) {
    mesh.triangles.push_back({first + t[0], first + t[1], first + t[2]});
  }
  return mesh;
}

TriangleMesh cube(double side) { return make_box({side, side, side}); }

/// Every face with corners of its own, as in an STL file.
TriangleMesh soup(const TriangleMesh& mesh) {
  TriangleMesh result;
  for (const Triangle& t : mesh.triangles) {
    const auto first = static_cast<std::uint32_t>(result.vertices.size());
    for (const std::uint32_t v : t) result.vertices.push_back(mesh.vertices[v]);
    result.triangles.push_back({first, first + 1, first + 2});
  }
  return result;
}

void expect_refused(const TriangleMesh& mesh, const std::string& words) {
  const auto solid = check_solid(mesh);
  ASSERT_FALSE(solid) << "accepted; expected: " << words;
  EXPECT_EQ(solid.error().code, Errc::bad_input);
  EXPECT_NE(solid.error().message.find(words), std::string::npos) << solid.error().message;
}

/// Accepted with the volume and so many warnings.
SolidMesh expect_accepted(const TriangleMesh& mesh, double volume, std::size_t num_warnings = 0) {
  const auto solid = check_solid(mesh);
  if (!solid) {
    ADD_FAILURE() << solid.error().message;
    return {};
  }
  EXPECT_NEAR(mass_properties(solid->mesh).volume, volume, 1e-6 * volume);
  EXPECT_EQ(solid->warnings.size(), num_warnings);
  return *solid;
}

TEST(CheckSolid, WeldsSoup) {
  const SolidMesh solid = expect_accepted(soup(make_icosphere(0.05, 2)),
                                          mass_properties(make_icosphere(0.05, 2)).volume);
  EXPECT_EQ(solid.mesh.vertices.size(), 162u);
  EXPECT_EQ(solid.mesh.triangles.size(), 320u);
}

TEST(CheckSolid, WeldsAlsoFarFromTheOrigin) {
  TriangleMesh mesh = soup(make_torus(0.05, 0.02, 40, 20));
  const double volume = mass_properties(mesh).volume;
  std::uint32_t random = 1;
  for (Vec3d& p : mesh.vertices) {
    for (int axis = 0; axis < 3; ++axis) {
      random = random * 1664525u + 1013904223u;
      p[axis] += 4e-9 * (random / 4294967296.0 - 0.5);  // Tolerance: 1.6e-8.
    }
  }
  EXPECT_EQ(expect_accepted(mesh, volume, 1).mesh.vertices.size(), 800u);
  EXPECT_EQ(expect_accepted(shifted(mesh, {1e3, -2e3, 5e2}), volume, 1).mesh.vertices.size(), 800u);
}

TEST(CheckSolid, WeldsAcrossTheCellsOfItsSearch) {
  // A tolerance of nearly half a cell, so that many of the corners to be joined lie in two cells.
  TriangleMesh mesh = soup(make_torus(0.05, 0.02, 40, 20));
  std::uint32_t random = 1;
  for (Vec3d& p : mesh.vertices) {
    for (int axis = 0; axis < 3; ++axis) {
      random = random * 1664525u + 1013904223u;
      p[axis] += 4e-6 * (random / 4294967296.0 - 0.5);
    }
  }
  MeshCheckOptions options;
  options.weld_fraction = 1e-4;  // 1.5e-5 m.
  const auto solid = check_solid(mesh, options);
  ASSERT_TRUE(solid) << solid.error().message;
  EXPECT_EQ(solid->mesh.vertices.size(), 800u);
}

TEST(CheckSolid, DropsUnusedVerticesEvenIfNotFinite) {
  TriangleMesh mesh = cube(0.1);
  mesh.vertices.push_back({100, std::nan(""), 0});
  EXPECT_EQ(expect_accepted(mesh, 1e-3).mesh.vertices.size(), 8u);
}

TEST(CheckSolid, DropsFacesThatWeldToAnEdge) {
  TriangleMesh mesh = cube(0.1);
  mesh.vertices.push_back(mesh.vertices[0]);
  mesh.triangles.push_back({0, 8, 3});
  mesh.triangles.push_back({0, 0, 1});
  EXPECT_EQ(expect_accepted(mesh, 1e-3, 1).mesh.triangles.size(), 12u);
}

TEST(CheckSolid, DropsHangingNeedles) {
  TriangleMesh mesh = cube(0.1);
  mesh.vertices.push_back(mesh.vertices[0] * 0.25 + mesh.vertices[3] * 0.75);
  mesh.triangles.push_back({0, 3, 8});
  EXPECT_EQ(expect_accepted(mesh, 1e-3, 1).mesh.triangles.size(), 12u);
}

TEST(CheckSolid, SplitsTheFaceBesideANeedleThatClosesTheSurface) {
  // The corner 8 lies on the edge 0-1; on one side the edge is split there, on the other it is
  // not, and a needle fills the crack.
  TriangleMesh mesh = cube(0.1);
  mesh.vertices.push_back(mesh.vertices[0] * 0.4 + mesh.vertices[1] * 0.6);
  mesh.triangles[4] = {0, 8, 5};
  mesh.triangles.push_back({8, 1, 5});
  mesh.triangles.push_back({0, 1, 8});
  const SolidMesh solid = expect_accepted(mesh, 1e-3, 1);
  EXPECT_EQ(solid.mesh.triangles.size(), 14u);
}

TEST(CheckSolid, TurnsInsideOut) {
  const SolidMesh solid = expect_accepted(rotated(make_octahedron(0.1)), 4.0 / 3 * 1.25e-4, 1);
  EXPECT_NE(solid.warnings.at(0).find("inside out"), std::string::npos);
}

TEST(CheckSolid, RefusesNoFaces) {
  expect_refused({}, "no faces");
  expect_refused({{{0, 0, 0}, {1, 0, 0}, {0, 1, 0}}, {}}, "no faces");
  expect_refused({{{0, 0, 0}, {1, 0, 0}, {0, 1, 0}}, {{0, 1, 1}, {2, 2, 0}}}, "has an area");
}

TEST(CheckSolid, RefusesBadNumbers) {
  TriangleMesh mesh = cube(0.1);
  mesh.triangles[5][2] = 8;
  expect_refused(mesh, "face 5 uses vertex 8");
  for (const double bad : {std::nan(""), HUGE_VAL, -HUGE_VAL}) {
    mesh = cube(0.1);
    mesh.vertices[3].y = bad;
    expect_refused(mesh, "not a finite number");
  }
  mesh = cube(0.1);
  mesh.vertices[3].y = std::numeric_limits<double>::max();
  mesh.vertices[2].y = -std::numeric_limits<double>::max();
  expect_refused(mesh, "m long");
}

TEST(CheckSolid, RefusesImplausibleSizes) {
  expect_refused(make_box({100, 60, 20}), "the mesh is 100 m long");
  expect_refused(make_box({100, 60, 20}), "--unit mm");
  expect_refused(cube(1e-5), "at least");
  expect_refused({{{1, 1, 1}, {1, 1, 1}, {1, 1, 1}}, {{0, 1, 2}}}, "at least");
  MeshCheckOptions options;
  options.max_extent = 1000;
  EXPECT_TRUE(check_solid(make_box({100, 60, 20}), options));
}

TEST(CheckSolid, CountsFaultyEdges) {
  TriangleMesh open = make_icosphere(0.05, 2);
  open.triangles.pop_back();
  expect_refused(open, "3 open edges");

  TriangleMesh flipped = make_icosphere(0.05, 2);
  std::swap(flipped.triangles[7][0], flipped.triangles[7][1]);
  expect_refused(flipped, "3 inconsistently oriented edges");

  TriangleMesh fin = cube(0.1);
  fin.vertices.push_back({0.1, 0.1, 0.1});
  fin.triangles.push_back({0, 1, 8});
  expect_refused(fin, "2 open edges (of one face only), 1 non-manifold edge");

  TriangleMesh doubled = cube(0.1);
  doubled.triangles.insert(doubled.triangles.end(), doubled.triangles.begin(),
                           doubled.triangles.end());
  expect_refused(doubled, "18 non-manifold edges");
}

TEST(CheckSolid, SaysWhereTheFirstFaultIs) {
  TriangleMesh mesh = shifted(cube(0.2), {1, 0, 0});
  mesh.triangles.erase(mesh.triangles.begin());  // 0, 2, 3: the face at the lower z.
  expect_refused(mesh, "the first at (0.9, 0, -0.1) m");
}

TEST(CheckSolid, RefusesTwoSidedSheets) {
  TriangleMesh sheet{{{0, 0, 0}, {0.1, 0, 0}, {0, 0.1, 0}}, {{0, 1, 2}, {0, 2, 1}}};
  expect_refused(sheet, "encloses no volume");
}

TEST(CheckSolid, RefusesSelfIntersection) {
  TriangleMesh mesh = make_torus(0.05, 0.02, 40, 20);
  mesh.vertices[0] = {-0.05, 0, 0};
  expect_refused(mesh, "crosses or touches itself");
}

TEST(CheckSolid, AcceptsSeparatePartsAndCavities) {
  expect_accepted(joined(cube(0.1), shifted(cube(0.1), {0.2, 0, 0})), 2e-3);
  const TriangleMesh hollow = joined(cube(0.2), rotated(cube(0.1)));
  expect_accepted(hollow, 7e-3);
  expect_accepted(joined(hollow, cube(0.05)), 7e-3 + 1.25e-4);   // A solid in the cavity.
  expect_accepted(joined(rotated(cube(0.1)), cube(0.2)), 7e-3);  // Whatever the order.
}

TEST(CheckSolid, TurnsWholeBodiesWithTheirCavities) {
  expect_accepted(rotated(joined(cube(0.2), rotated(cube(0.1)))), 7e-3, 1);
  expect_accepted(joined(cube(0.1), rotated(shifted(cube(0.1), {0.2, 0, 0}))), 2e-3, 1);
}

TEST(CheckSolid, RefusesWrongNesting) {
  expect_refused(joined(cube(0.2), cube(0.1)), "same orientation");
  const TriangleMesh hollow = joined(cube(0.2), rotated(cube(0.1)));
  expect_refused(joined(hollow, rotated(cube(0.05))), "same orientation");
}

TEST(CheckSolid, RefusesOverlappingOrTouchingParts) {
  expect_refused(joined(cube(0.1), shifted(cube(0.1), {0.05, 0.03, 0.02})), "touch or overlap");
  expect_refused(joined(cube(0.1), shifted(cube(0.1), {0.1, 0.03, 0.02})), "touch or overlap");
  expect_refused(joined(cube(0.1), shifted(cube(0.1), {0.1, 0.1, 0})), "non-manifold");
}

TEST(CheckSolid, AcceptsAnyPose) {
  for (const std::string& name : shape_names()) {
    SCOPED_TRACE(name);
    TriangleMesh mesh = *make_shape(name, 0.15);
    const double volume = mass_properties(mesh).volume;
    const Pose pose{{12, -7, 3}, axis_angle({1, 2, 3}, 0.7)};
    for (Vec3d& p : mesh.vertices) p = pose * p;
    expect_accepted(mesh, volume);
  }
}

TEST(CheckSolid, IsIdempotentAndRepeatable) {
  const auto first = check_solid(soup(make_torus(0.05, 0.02, 60, 30)));
  ASSERT_TRUE(first);
  const auto second = check_solid(first->mesh);
  ASSERT_TRUE(second);
  EXPECT_EQ(first->mesh.vertices, second->mesh.vertices);
  EXPECT_EQ(first->mesh.triangles, second->mesh.triangles);
}

TEST(CheckSolid, FindsWhichPartsAreInOthers) {
  // Beside each other, but where one looks along x from another: in the hole of a ring, in a bowl.
  const TriangleMesh ring = make_torus(0.05, 0.01, 40, 20), ball = make_icosphere(0.02, 2);
  const Quaternion turn = axis_angle({0, 1, 0}, 1.1);
  const auto turned = [&](TriangleMesh mesh) {
    for (Vec3d& p : mesh.vertices) p = rotate(turn, p);
    return mesh;
  };
  const double volume = mass_properties(ring).volume + mass_properties(ball).volume;
  expect_accepted(joined(ring, ball), volume);
  expect_accepted(turned(joined(ball, ring)), volume);
  expect_refused(turned(joined(ring, shifted(make_icosphere(0.005, 1), {0.05, 0, 0}))),
                 "same orientation");
  // A ray along x from the end of one meets edges and corners of the others.
  const TriangleMesh octahedra =
      joined(make_octahedron(0.02), shifted(make_octahedron(0.02), {0.03, 0, 0}));
  expect_accepted(octahedra, 8.0 / 3 * 1e-6);
  expect_accepted(joined(octahedra, rotated(shifted(make_octahedron(0.01), {0.03, 0, 0}))),
                  8.0 / 3 * 1e-6 - 1.0 / 6 * 1e-6);
  expect_refused(joined(octahedra, shifted(make_octahedron(0.01), {0.03, 0, 0})),
                 "same orientation");
}

TEST(CheckSolid, ManyNestedPartsAreFine) {
  TriangleMesh mesh;
  double volume = 0;
  for (int i = 0; i < 4000; ++i) {
    const TriangleMesh shell = make_tetrahedron(0.1 + 2e-5 * i);
    volume += (i % 2 ? 1 : -1) * mass_properties(shell).volume;
    const auto first = static_cast<std::uint32_t>(mesh.vertices.size());
    mesh.vertices.insert(mesh.vertices.end(), shell.vertices.begin(), shell.vertices.end());
    for (Triangle t : shell.triangles) {
      if (i % 2 == 0) std::swap(t[1], t[2]);
      mesh.triangles.push_back({first + t[0], first + t[1], first + t[2]});
    }
  }
  expect_accepted(mesh, volume);
  for (int k = 0; k < 4; ++k) std::swap(mesh.triangles[k][1], mesh.triangles[k][2]);
  expect_refused(mesh, "same orientation");
}

TEST(CheckSolid, ManyCornersInOnePlaceAreFine) {
  // A fine sphere of 0.1 mm beside a tetrahedron at 1 m.
  const TriangleMesh ball = make_icosphere(1e-4, 4),
                     far = shifted(make_tetrahedron(0.01), {1, 0, 0});
  const SolidMesh solid =
      expect_accepted(soup(joined(ball, far)), mass_properties(joined(ball, far)).volume);
  EXPECT_EQ(solid.mesh.vertices.size(), ball.vertices.size() + 4);
}

TEST(CheckSolid, ManyPartsAreFine) {
  TriangleMesh mesh;
  for (int i = 0; i < 1000; ++i) {
    mesh = joined(std::move(mesh),
                  shifted(make_octahedron(0.01),
                          Vec3d{double(i % 10), double(i / 10 % 10), double(i / 100)} * 0.02));
  }
  expect_accepted(mesh, 1000 * 4.0 / 3 * 1.25e-7);
}

}  // namespace
}  // namespace palpate
