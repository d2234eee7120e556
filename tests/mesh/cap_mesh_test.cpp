// Cap meshes against closed forms.
#include "palpate/mesh/mesh.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <map>
#include <utility>
#include <vector>

#include <gtest/gtest.h>

#include "tests/test_util/random.h"

namespace palpate {
namespace {

/// Signed distance of the center in front of a plane with a normal of any length.
double distance_of(const Sphere& sphere, const Plane<double>& plane) {
  return (dot(plane.normal, to_double(sphere.center)) - plane.offset) / norm(plane.normal);
}

/// The plane with this normal that has the center at `distance` in front.
Plane<double> plane_at(const Sphere& sphere, const Vec3d& normal, double distance) {
  return {normal, dot(normal, to_double(sphere.center)) - distance * norm(normal)};
}

double volume_of(const TriangleMesh& mesh) { return mass_properties(mesh).volume; }

/// Every edge is used once in each direction, and every vertex is used.
void expect_closed(const TriangleMesh& mesh) {
  std::map<std::pair<std::uint32_t, std::uint32_t>, int> edges;
  std::vector<bool> is_used(mesh.vertices.size());
  for (const auto& t : mesh.triangles) {
    for (int k = 0; k < 3; ++k) {
      ASSERT_LT(t[k], mesh.vertices.size());
      is_used[t[k]] = true;
      ++edges[{t[k], t[(k + 1) % 3]}];
    }
  }
  for (const auto& [edge, count] : edges) {
    ASSERT_EQ(count, 1);
    ASSERT_TRUE(edges.contains({edge.second, edge.first}));
  }
  EXPECT_EQ(std::count(is_used.begin(), is_used.end(), false), 0);
}

/// No triangle is without area, and all look away from a point inside of a convex mesh.
void expect_convex(const TriangleMesh& mesh, double radius) {
  const Vec3d middle = mass_properties(mesh).center_of_mass;
  for (const auto& t : mesh.triangles) {
    const Vec3d &a = mesh.vertices[t[0]], &b = mesh.vertices[t[1]], &c = mesh.vertices[t[2]];
    const Vec3d area = cross(b - a, c - a);
    ASSERT_GT(norm(area), 1e-12 * radius * radius);
    ASSERT_GT(dot(area, a - middle), 0);
  }
}

/// Vertices on the sphere, those of the plane apart, none in front of the plane.
void expect_inscribed(const TriangleMesh& mesh, const Sphere& sphere, const Plane<double>& plane) {
  const double length = norm(plane.normal), radius = sphere.radius;
  int num_off_sphere = 0;
  for (const Vec3d& p : mesh.vertices) {
    const double in_front = length > 0 ? (dot(plane.normal, p) - plane.offset) / length : -radius;
    EXPECT_LT(in_front, 1e-12);
    if (std::abs(norm(p - to_double(sphere.center)) - radius) < 1e-12) continue;
    ++num_off_sphere;  // only the center of the disc
    EXPECT_NEAR(in_front, 0, 1e-12);
    const Vec3d to_center = to_double(sphere.center) - p;
    EXPECT_NEAR(norm(cross(to_center, plane.normal)) / length, 0, 1e-12);
  }
  EXPECT_LE(num_off_sphere, 1);
}

// An inscribed prism of rings: the exact volume for given heights and radii of its rings, which
// says what the mesh should have, ring by ring.
double volume_of_rings(double radius, double opening, int rings, int segments) {
  const double area = segments / 2.0 * std::sin(2 * kPi / segments);
  double volume = 0;
  for (int k = 0; k < rings; ++k) {
    const double a = opening * k / rings, b = opening * (k + 1) / rings;
    const double ra = radius * std::sin(a), rb = radius * std::sin(b);
    volume += area / 3 * radius * (std::cos(a) - std::cos(b)) * (ra * ra + ra * rb + rb * rb);
  }
  return volume;
}

TEST(CapMesh, TheSphereOfTheThesis) {  // Fig. 4.5; the printed normal is not unit
  const Sphere sphere{{3, 1, 2}, 3};
  const Vec3d origin{1.14, 1.1, 1.8}, normal{-0.52, 0.77, -0.36};
  const Plane<double> plane{normal, dot(normal, origin)};
  const double distance = distance_of(sphere, plane);
  EXPECT_NEAR(norm(normal), 0.99644, 5e-6);
  EXPECT_NEAR(distance, -1.12018, 5e-6);

  const int segments = 64;
  const TriangleMesh mesh = cap_mesh(sphere, plane, segments);
  expect_closed(mesh);
  expect_convex(mesh, 3);
  expect_inscribed(mesh, sphere, plane);
  // The last vertex is the center of the disc, the ring before it the circle.
  const Vec3d disc = mesh.vertices.back();
  EXPECT_NEAR(disc.x, 2.4154, 5e-5);
  EXPECT_NEAR(disc.y, 1.8656, 5e-5);
  EXPECT_NEAR(disc.z, 1.5953, 5e-5);
  for (std::size_t k = 2; k < 2 + segments; ++k) {
    const Vec3d p = mesh.vertices[mesh.vertices.size() - k];
    EXPECT_NEAR(norm(p - disc), 2.78302, 5e-6);
    const double theta = std::acos(dot(p - to_double(sphere.center), normal) / (3 * norm(normal)));
    EXPECT_NEAR(theta, 1.18813, 5e-6);
  }
  EXPECT_NEAR(cap_volume(3.0, distance), 86.7492, 5e-5);
  EXPECT_NEAR(volume_of(mesh) / 86.7492, 1, 5e-3);
  EXPECT_LT(volume_of(mesh), 86.7492);
  EXPECT_NEAR(volume_of(cap_mesh(sphere, plane, 1000)) / 86.7492, 1, 2e-5);
}

TEST(CapMesh, RandomCapsAreClosedConvexAndInscribed) {
  test::Random random(1);
  for (int i = 0; i < 300; ++i) {
    const Sphere sphere{to_float(random.in_box(0.3)),
                        static_cast<float>(random.uniform(1e-3, 0.2))};
    const double radius = sphere.radius;
    const double distance = radius * random.uniform(-1, 1);
    const Plane<double> plane =
        plane_at(sphere, random.direction() * random.uniform(0.5, 2), distance);
    const int segments = 3 + static_cast<int>(random.bits() % 40);
    SCOPED_TRACE(::testing::Message() << distance / radius << " " << segments);
    const TriangleMesh mesh = cap_mesh(sphere, plane, segments);
    expect_closed(mesh);
    expect_convex(mesh, radius);
    expect_inscribed(mesh, sphere, plane);
    EXPECT_LE(mesh.triangles.size(), max_cap_triangles(segments));

    // Circles and rings follow from the number of vertices: two apexes and the circles.
    const std::size_t circles = (mesh.vertices.size() - 2) / static_cast<std::size_t>(segments);
    EXPECT_EQ(mesh.vertices.size(), circles * static_cast<std::size_t>(segments) + 2);
    const double opening = std::acos(std::clamp(distance / radius, -1.0, 1.0));
    const double volume = volume_of(mesh);
    const double exact = cap_volume(radius, distance);
    EXPECT_GT(volume, 0);
    EXPECT_LT(volume, exact);
    EXPECT_NEAR(volume / volume_of_rings(radius, opening, static_cast<int>(circles), segments), 1,
                1e-8);
  }
}

TEST(CapMesh, VolumesConvergeWithTheSquareOfTheSegments) {
  const Sphere sphere{{0.1f, -0.2f, 0.5f}, 0.02f};
  const double radius = sphere.radius;
  const Vec3d normal{0.3, -0.5, 0.8};
  // Openings of which the rings double with the segments: half and whole spheres, and two thirds.
  for (const double cosine : {0.0, -1.0, -0.5}) {
    SCOPED_TRACE(cosine);
    const Plane<double> plane = plane_at(sphere, normal, cosine * radius);
    const double exact = cap_volume(radius, cosine * radius);
    double coarse = 0;
    for (const int segments : {12, 24, 48, 96, 192}) {
      const double fine = volume_of(cap_mesh(sphere, plane, segments));
      EXPECT_LT(1 - fine / exact, 17.0 / (segments * segments));
      if (segments > 12) {
        EXPECT_NEAR((exact - coarse) / (exact - fine), 4, segments > 24 ? 0.04 : 0.2);
        // Richardson: what is left is of fourth order.
        const double better = fine + (fine - coarse) / 3;
        EXPECT_NEAR(better / exact, 1, 500 / std::pow(segments, 4));
      }
      coarse = fine;
    }
  }
  // Any other cap. The polygons miss (2 pi / segments)^2 / 6 of it and the rings half as much again
  // (whole ball) to twice as much (flat cap): 20 / segments^2 at most.
  test::Random random(2);
  for (int i = 0; i < 100; ++i) {
    const double distance = radius * random.uniform(-1, 1);
    const double exact = cap_volume(radius, distance);
    for (const int segments : {24, 96, 240}) {
      const double missing =
          1 - volume_of(cap_mesh(sphere, plane_at(sphere, normal, distance), segments)) / exact;
      EXPECT_GT(missing, 0);
      EXPECT_LT(missing, 20.0 / (segments * segments)) << distance / radius;
    }
  }
}

TEST(CapMesh, TrianglesAreAboutAsHighAsWide) {
  const Sphere sphere{{0, 0, 0}, 1};
  for (const double distance : {-0.9, -0.5, 0.0, 0.5, 0.9, 0.99, 0.9999}) {
    SCOPED_TRACE(distance);
    const int segments = 48;
    const TriangleMesh mesh = cap_mesh(sphere, {{0, 0, 1}, -distance}, segments);
    double widest = 0, highest = 0;
    for (std::size_t v = 1; v + 1 + segments < mesh.vertices.size(); ++v) {
      // Vertex 0 and v + segments are one ring apart, if 0 is on the first circle.
      highest = std::max(highest, norm(mesh.vertices[v + segments] - mesh.vertices[v]));
      widest = std::max(widest, norm(mesh.vertices[v + 1] - mesh.vertices[v]));
    }
    EXPECT_GT(highest, 0);
    if (distance < 0.99) {
      EXPECT_NEAR(highest / widest, 0.9, 0.15);
    }
  }
}

TEST(CapMesh, PlanesThroughTheCenterMakeHalves) {
  const Sphere sphere{{0.3f, -0.1f, 0.7f}, 0.05f};
  test::Random random(3);
  for (int i = 0; i < 20; ++i) {
    const Vec3d n = random.direction();
    const TriangleMesh behind = cap_mesh(sphere, plane_at(sphere, n, 0), 24);
    const TriangleMesh in_front = cap_mesh(sphere, plane_at(sphere, -n, 0), 24);
    const TriangleMesh whole = cap_mesh(sphere, {}, 24);
    EXPECT_EQ(behind.triangles.size(), 24u * (2 * 6));
    EXPECT_NEAR(volume_of(behind) / volume_of(in_front), 1, 1e-12);
    EXPECT_NEAR(2 * volume_of(behind) / volume_of(whole), 1, 1e-12);
  }
  for (const Vec3d& n : {Vec3d{1, 0, 0}, {0, -1, 0}, {0, 0, 1}, {1, 1, 1}, {-1, 1, 0}}) {
    const TriangleMesh mesh = cap_mesh(sphere, plane_at(sphere, n, 0), 24);
    expect_closed(mesh);
    expect_convex(mesh, 0.05);
  }
}

TEST(CapMesh, PlanesThatDoNotCutGiveTheWholeBallOrNothing) {
  const Sphere sphere{{0.3f, -0.1f, 0.7f}, 0.05f};
  const double radius = sphere.radius;
  const TriangleMesh whole = cap_mesh(sphere, {}, 24);
  expect_closed(whole);
  expect_convex(whole, radius);
  expect_inscribed(whole, sphere, {});
  EXPECT_EQ(whole.vertices.size(), 11u * 24 + 2);
  EXPECT_NEAR(volume_of(whole), volume_of_rings(radius, kPi, 12, 24), 1e-15);
  const auto solid = check_solid(whole);
  ASSERT_TRUE(solid) << solid.error().message;
  EXPECT_TRUE(solid->warnings.empty());
  for (const double r : {-1.0, -1.5, -100.0}) {
    const TriangleMesh mesh = cap_mesh(sphere, plane_at(sphere, {0, 0, 2}, r * radius), 24);
    EXPECT_EQ(mesh.triangles, whole.triangles);
    EXPECT_EQ(mesh.vertices, whole.vertices);
  }
  for (const double r : {1.0, 1.5, 100.0}) {
    EXPECT_TRUE(cap_mesh(sphere, plane_at(sphere, {0, 0, 2}, r * radius), 24).vertices.empty());
  }
}

TEST(CapMesh, NearTangentPlanes) {
  const Sphere sphere{{0.3f, -0.1f, 0.7f}, 0.05f};
  const double radius = sphere.radius;
  for (const Vec3d& n : {Vec3d{0, 0, 1}, normalized(Vec3d{1, -2, 0.5})}) {
    for (double height = 1; height > 1e-12; height /= 3) {
      SCOPED_TRACE(height);
      for (const double distance : {radius * (1 - height), -radius * (1 - height)}) {
        const Plane<double> plane = plane_at(sphere, n, distance);
        const TriangleMesh mesh = cap_mesh(sphere, plane, 24);
        if (height < 0.999 * kFlattestCap) {
          if (distance > 0) {
            EXPECT_TRUE(mesh.vertices.empty());
          } else {
            EXPECT_EQ(mesh.vertices.size(), 11u * 24 + 2);
          }
          continue;
        }
        expect_closed(mesh);
        expect_inscribed(mesh, sphere, plane);
        const double exact = cap_volume(radius, distance);
        // A cap this flat, 0.7 m from the origin, has its height to 1e-16 / (1e-6 * 0.05) only.
        EXPECT_NEAR(volume_of(mesh) / exact, 0.98, 0.02);
        if (height > 1e-4) expect_convex(mesh, radius * std::sqrt(height));
      }
    }
  }
}

TEST(CapMesh, PlanesInSinglePrecisionAreNotQuiteUnit) {
  // As ContactQuery::planes gives them: the length of the normal must not shift the cut.
  const Sphere sphere{{3.3f, -2.1f, 4.7f}, 0.001f};
  const Vec3d n = normalized(Vec3d{0.4, 0.3, -0.7});
  const Plane<double> plane = plane_at(sphere, n, 2e-4);
  const TriangleMesh exact = cap_mesh(sphere, plane, 24);
  const TriangleMesh scaled = cap_mesh(sphere, {plane.normal * 1e3, plane.offset * 1e3}, 24);
  ASSERT_EQ(exact.vertices.size(), scaled.vertices.size());
  for (std::size_t v = 0; v < exact.vertices.size(); ++v) {
    EXPECT_NEAR(norm(exact.vertices[v] - scaled.vertices[v]), 0, 1e-14);
  }
}

TEST(InsideMesh, IsOneShellForEachSphereThatHasAPart) {
  test::Random random(4);
  std::vector<Sphere> spheres;
  std::vector<Plane<double>> planes;
  double volume = 0, exact = 0;
  std::size_t num_triangles = 0, num_inside = 0;
  for (int i = 0; i < 50; ++i) {
    spheres.push_back(
        {to_float(random.in_box(0.3)), static_cast<float>(random.uniform(1e-3, 0.1))});
    const double radius = spheres.back().radius;
    const double distance = radius * random.uniform(-2, 2);
    planes.push_back(i % 10 == 0 ? Plane<double>{}
                                 : plane_at(spheres.back(), random.direction(), distance));
    const TriangleMesh one = cap_mesh(spheres.back(), planes.back(), 24);
    volume += volume_of(one);
    exact += i % 10 == 0 ? sphere_volume(radius) : cap_volume(radius, distance);
    num_triangles += one.triangles.size();
    num_inside += !one.triangles.empty();
  }
  const TriangleMesh mesh = inside_mesh(spheres, planes, 24);
  expect_closed(mesh);
  EXPECT_EQ(mesh.triangles.size(), num_triangles);
  EXPECT_NEAR(volume_of(mesh), volume, 1e-12 * volume);
  EXPECT_NEAR(volume_of(mesh) / exact, 0.98, 0.01);
  // Euler: two for each closed shell without holes.
  const auto v = mesh.vertices.size(), f = mesh.triangles.size();
  EXPECT_EQ(v - 3 * f / 2 + f, 2 * num_inside);
  EXPECT_TRUE(inside_mesh({}, {}, 24).vertices.empty());
}

}  // namespace
}  // namespace palpate
