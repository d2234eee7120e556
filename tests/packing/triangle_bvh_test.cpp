#include "src/packing/solid/triangle_bvh.h"

#include <algorithm>

#include <gtest/gtest.h>

#include "palpate/mesh/mesh.h"
#include "tests/test_util/random.h"

namespace palpate {
namespace {

// Independent of the region walk in the library: the foot on the plane if it is inside, else the
// best of the three edges.
double distance_to_triangle(const Triangle& t, const Vec3d& p) {
  const Vec3d n = cross(t.b - t.a, t.c - t.a);
  const Vec3d foot = p - n * (dot(n, p - t.a) / dot(n, n));
  const auto left = [&](const Vec3d& a, const Vec3d& b) {
    return dot(cross(b - a, foot - a), n) >= 0;
  };
  if (left(t.a, t.b) && left(t.b, t.c) && left(t.c, t.a)) return norm(p - foot);
  const auto to_edge = [&](const Vec3d& a, const Vec3d& b) {
    const double s = std::clamp(dot(p - a, b - a) / dot(b - a, b - a), 0.0, 1.0);
    return norm(p - (a + (b - a) * s));
  };
  return std::min({to_edge(t.a, t.b), to_edge(t.b, t.c), to_edge(t.c, t.a)});
}

std::vector<TriangleMesh> meshes() {
  std::vector<TriangleMesh> all;
  for (const std::string& name : shape_names()) all.push_back(make_shape(name, 0.1).value());
  all.push_back(make_box({1, 0.5, 1e-4}));
  for (Vec3d& p : all.back().vertices) {
    p = rotate(axis_angle({1, 2, 3}, 0.7), p) + Vec3d{5, -7, 3};
  }
  return all;
}

TEST(TriangleBvh, ClosestPointIsThatOfBruteForce) {
  test::Random random(1);
  for (const TriangleMesh& mesh : meshes()) {
    const TriangleBvh bvh(mesh);
    const Bounds box = bounds(mesh);
    const Vec3d center = (box.low + box.high) * 0.5;
    const double size = norm(box.high - box.low);
    for (int i = 0; i < 200; ++i) {
      const Vec3d p = center + random.in_box(0.6 * size);
      double expected = 1e300;
      for (int t = 0; t < bvh.num_triangles(); ++t) {
        expected = std::min(expected, distance_to_triangle(bvh.triangle(t), p));
      }
      const auto found = bvh.closest(p, 1e300);
      EXPECT_NEAR(found.distance, expected, 1e-13 * size);
      EXPECT_NEAR(norm(p - found.point), expected, 1e-13 * size);
      EXPECT_LT(bvh.closest(p, 0.9 * expected).triangle, 0);
      EXPECT_GE(bvh.closest(p, 1.1 * expected).triangle, 0);
      EXPECT_LE(bvh.closest(p, 1e300, 0.05).distance, 1.05 * expected + 1e-13 * size);

      std::vector<int> near;
      ASSERT_TRUE(bvh.gather(p, 1.3 * expected, mesh.triangles.size(), near));
      std::sort(near.begin(), near.end());
      std::vector<int> all;
      for (int t = 0; t < bvh.num_triangles(); ++t) {
        if (distance_to_triangle(bvh.triangle(t), p) <= 1.3 * expected) all.push_back(t);
      }
      EXPECT_EQ(near, all);
      near.clear();
      EXPECT_EQ(bvh.gather(p, 1.3 * expected, all.size() - 1, near), false);
    }
  }
}

TEST(TriangleBvh, InsideIsTheSideOfTheClosedForm) {
  test::Random random(2);
  const TriangleBvh box(make_box({1, 2, 3}));
  const TriangleBvh torus(make_torus(1, 0.4, 64, 32));
  for (int i = 0; i < 2000; ++i) {
    const Vec3d p = random.in_box(1.6);
    const bool in_box = std::abs(p.x) < 0.5 && std::abs(p.y) < 1 && std::abs(p.z) < 1.5;
    EXPECT_EQ(box.inside(p), in_box);
    const double from_ring = std::hypot(std::hypot(p.x, p.y) - 1, p.z);
    if (std::abs(from_ring - 0.4) > 0.02) {
      EXPECT_EQ(torus.inside(p), from_ring < 0.4);
    }
  }
  // On the symmetry planes and through the diagonal edges.
  EXPECT_TRUE(box.inside({0, 0, 0}));
  EXPECT_FALSE(box.inside({0.5 + 1e-9, 0, 0}));
  EXPECT_FALSE(torus.inside({0, 0, 0}));
}

TEST(TriangleBvh, BuildsFromEqualTriangles) {
  TriangleMesh mesh;
  mesh.vertices = {{0, 0, 0}, {1, 0, 0}, {0, 1, 0}};
  mesh.triangles.assign(10000, {0, 1, 2});
  const TriangleBvh bvh(mesh);
  EXPECT_DOUBLE_EQ(bvh.closest({0.2, 0.2, 0.5}, 1e300).distance, 0.5);
}

}  // namespace
}  // namespace palpate
