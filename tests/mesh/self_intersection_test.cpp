// The search for self-intersections against brute force and in the awkward cases.
#include "src/mesh/self_intersection.h"

#include <algorithm>
#include <cmath>
#include <random>
#include <vector>

#include <gtest/gtest.h>

#include "palpate/math/geometry.h"
#include "palpate/mesh/mesh.h"

namespace palpate {
namespace {

using Triangle = std::array<std::uint32_t, 3>;

/// Does the segment pq pierce the triangle? Moeller and Trumbore's test; the random meshes here
/// have no touching cases.
bool pierces(const Vec3d& p, const Vec3d& q, const Vec3d& a, const Vec3d& b, const Vec3d& c) {
  const Vec3d e1 = b - a, e2 = c - a, d = q - p, h = cross(d, e2);
  const double det = dot(e1, h);
  if (std::abs(det) < 1e-12) return false;  // Parallel but for rounding, as on the flat caps.
  const Vec3d s = p - a;
  const double u = dot(s, h) / det;
  const Vec3d k = cross(s, e1);
  const double v = dot(d, k) / det, t = dot(e2, k) / det;
  return u >= 0 && v >= 0 && u + v <= 1 && t >= 0 && t <= 1;
}

bool faces_meet(const TriangleMesh& mesh, const Triangle& f, const Triangle& g) {
  const auto has = [](const Triangle& t, std::uint32_t v) {
    return std::find(t.begin(), t.end(), v) != t.end();
  };
  const auto one_way = [&](const Triangle& edges_of, const Triangle& target) {
    for (int k = 0; k < 3; ++k) {
      const std::uint32_t p = edges_of[k], q = edges_of[(k + 1) % 3];
      if (has(target, p) || has(target, q)) continue;  // These meet at the shared corner.
      if (pierces(mesh.vertices[p], mesh.vertices[q], mesh.vertices[target[0]],
                  mesh.vertices[target[1]], mesh.vertices[target[2]])) {
        return true;
      }
    }
    return false;
  };
  return one_way(f, g) || one_way(g, f);
}

bool brute_force(const TriangleMesh& mesh) {
  for (std::size_t i = 0; i < mesh.triangles.size(); ++i) {
    for (std::size_t j = 0; j < i; ++j) {
      if (faces_meet(mesh, mesh.triangles[i], mesh.triangles[j])) return true;
    }
  }
  return false;
}

void expect_same_as_brute_force(const TriangleMesh& mesh, int& num_meeting) {
  const auto found = *find_self_intersection(mesh);
  EXPECT_EQ(found.has_value(), brute_force(mesh));
  if (!found) return;
  ++num_meeting;
  EXPECT_TRUE(faces_meet(mesh, mesh.triangles[found->first], mesh.triangles[found->second]));
}

TEST(SelfIntersection, AgreesWithBruteForceOnCrumpledSpheres) {
  std::mt19937 random(1);
  int num_meeting = 0;
  for (int trial = 0; trial < 200; ++trial) {
    TriangleMesh mesh = make_icosphere(1, trial % 3);
    std::normal_distribution<double> noise(0, 0.4 / (1 + 3 * (trial % 3)));
    for (Vec3d& p : mesh.vertices) p += {noise(random), noise(random), noise(random)};
    expect_same_as_brute_force(mesh, num_meeting);
  }
  EXPECT_GT(num_meeting, 30);
  EXPECT_LT(num_meeting, 170);
}

TEST(SelfIntersection, AgreesWithBruteForceOnTriangleSoup) {
  std::mt19937 random(2);
  std::uniform_real_distribution<double> uniform(-1, 1);
  const auto point = [&] { return Vec3d{uniform(random), uniform(random), uniform(random)}; };
  int num_meeting = 0;
  for (int trial = 0; trial < 200; ++trial) {
    TriangleMesh mesh;
    for (std::uint32_t face = 0; face < 40; ++face) {
      const Vec3d center = point();
      for (int k = 0; k < 3; ++k) mesh.vertices.push_back(center + point() * 0.15);
      mesh.triangles.push_back({3 * face, 3 * face + 1, 3 * face + 2});
    }
    expect_same_as_brute_force(mesh, num_meeting);
  }
  EXPECT_GT(num_meeting, 30);
  EXPECT_LT(num_meeting, 170);
}

TEST(SelfIntersection, AgreesWithBruteForceOnMovedPairsOfSolids) {
  std::mt19937 random(3);
  std::uniform_real_distribution<double> uniform(-1, 1);
  const auto point = [&] { return Vec3d{uniform(random), uniform(random), uniform(random)}; };
  int num_meeting = 0;
  for (int trial = 0; trial < 100; ++trial) {
    TriangleMesh mesh = make_torus(0.7, 0.2, 12, 8);
    const TriangleMesh other = make_cylinder(0.15, 1.5, 9);
    const Pose pose{point() * 0.8, axis_angle(point(), 3 * uniform(random))};
    const auto first = static_cast<std::uint32_t>(mesh.vertices.size());
    for (const Vec3d& p : other.vertices) mesh.vertices.push_back(pose * p);
    for (const auto& t : other.triangles) {
      mesh.triangles.push_back({first + t[0], first + t[1], first + t[2]});
    }
    expect_same_as_brute_force(mesh, num_meeting);
  }
  EXPECT_GT(num_meeting, 30);
  EXPECT_LT(num_meeting, 90);
}

/// Two fans over a common rim: around the tip and, if `with_base`, around the middle of the base.
TriangleMesh make_cone(std::uint32_t num_facets, double height, bool with_base) {
  TriangleMesh mesh;
  mesh.vertices = {{0, 0, height}, {0, 0, 0}};
  for (std::uint32_t i = 0; i < num_facets; ++i) {
    const double angle = 6.283185307179586 * i / num_facets;
    mesh.vertices.push_back({std::cos(angle), std::sin(angle), 0});
    const std::uint32_t from = 2 + i, to = 2 + (i + 1) % num_facets;
    mesh.triangles.push_back({0, from, to});
    if (with_base) mesh.triangles.push_back({1, to, from});
  }
  return mesh;
}

TEST(SelfIntersection, AgreesWithBruteForceOnCrumpledCones) {
  std::mt19937 random(4);
  int num_meeting = 0;
  for (int trial = 0; trial < 200; ++trial) {
    TriangleMesh mesh = make_cone(60, trial % 2, true);
    mesh.vertices[1].z -= 1;
    std::normal_distribution<double> noise(0, 0.01 * (1 + trial % 5));
    for (Vec3d& p : mesh.vertices) p += {noise(random), noise(random), 5 * noise(random)};
    expect_same_as_brute_force(mesh, num_meeting);
  }
  EXPECT_GT(num_meeting, 30);
  EXPECT_LT(num_meeting, 170);
}

/// Two triangles with corners on a small grid; equal corners are shared.
using Corners = GridPoint[3];
bool meet(const Corners& a, const Corners& b) {
  std::vector<GridPoint> names;
  const auto triangle = [&](const Corners& points) {
    GridTriangle t{};
    for (int k = 0; k < 3; ++k) {
      auto name = std::find(names.begin(), names.end(), points[k]);
      if (name == names.end()) name = names.insert(name, points[k]);
      t.p[k] = points[k];
      t.vertex[k] = static_cast<std::uint32_t>(name - names.begin());
    }
    return t;
  };
  const GridTriangle first = triangle(a), second = triangle(b);
  EXPECT_EQ(triangles_meet(first, second), triangles_meet(second, first));
  return triangles_meet(first, second);
}

TEST(SelfIntersection, AwkwardPairs) {
  const GridPoint o{0, 0, 0}, x{4, 0, 0}, y{0, 4, 0}, z{0, 0, 4};
  EXPECT_TRUE(meet({o, x, y}, {o, y, x}));                     // Both sides of one triangle.
  EXPECT_FALSE(meet({o, x, y}, {x, o, z}));                    // Neighbors at a right angle.
  EXPECT_FALSE(meet({o, x, y}, {y, x, {4, 4, 0}}));            // Flat neighbors.
  EXPECT_TRUE(meet({o, x, y}, {y, x, {1, 1, 0}}));             // One folded onto the other.
  EXPECT_FALSE(meet({o, x, y}, {y, x, {1, 1, 1}}));            // Nearly folded.
  EXPECT_FALSE(meet({o, x, y}, {o, {-4, 0, 0}, {0, -4, 0}}));  // Flat, common corner.
  EXPECT_TRUE(meet({o, x, y}, {o, {1, 1, 0}, {9, 1, 0}}));     // The same, overlapping.
  EXPECT_TRUE(meet({o, x, y}, {o, {2, 0, 0}, {2, -4, 0}}));    // A shorter edge on a longer one.
  EXPECT_FALSE(meet({o, x, y}, {o, {1, 1, 1}, {1, 1, 2}}));    // Common corner only.
  EXPECT_TRUE(meet({o, x, y}, {o, {1, 1, 1}, {1, 1, -1}}));    // Piercing from the common corner.
  EXPECT_TRUE(meet({o, x, y}, {{1, 1, 0}, {1, 1, 5}, {2, 2, 5}}));      // A corner on a face.
  EXPECT_TRUE(meet({o, x, y}, {{2, 0, 0}, {1, 0, 5}, {2, -3, 5}}));     // A corner on an edge.
  EXPECT_FALSE(meet({o, x, y}, {{1, 1, 1}, {1, 1, 5}, {2, 2, 5}}));     // Just above.
  EXPECT_TRUE(meet({o, x, y}, {{1, 1, 0}, {2, 1, 0}, {1, 2, 0}}));      // Inside, same plane.
  EXPECT_FALSE(meet({o, x, y}, {{3, 3, 0}, {5, 3, 0}, {3, 5, 0}}));     // Beside, same plane.
  EXPECT_TRUE(meet({o, x, y}, {{-1, -1, 0}, {9, -1, 0}, {-1, 9, 0}}));  // Around, same plane.
}

TEST(SelfIntersection, GridKeepsItsFullRange) {
  const std::int64_t n = std::int64_t(1) << kGridBits;
  const Corners big = {{0, 0, 0}, {n, 0, n}, {0, n, n}};
  // The plane z = x + y; one step off it decides.
  EXPECT_TRUE(meet(big, {{n / 4, n / 4, n / 2}, {0, 0, n}, {1, 0, n}}));
  EXPECT_FALSE(meet(big, {{n / 4, n / 4, n / 2 + 1}, {0, 0, n}, {1, 0, n}}));
}

TEST(SelfIntersection, LargeMeshesAreFine) {
  EXPECT_FALSE(*find_self_intersection(make_torus(0.05, 0.02, 400, 125)));  // 100,000 faces.
  TriangleMesh touching = make_torus(0.05, 0.02, 200, 100);
  touching.vertices[0] = {-0.05, 0, 0};
  EXPECT_TRUE(*find_self_intersection(touching));
  EXPECT_FALSE(*find_self_intersection({}));
}

// All boxes overlap at the tip: pair by pair this would take minutes.
TEST(SelfIntersection, LargeFansAreFine) {
  const Quaternion turn = axis_angle({1, 2, 3}, 0.7);
  for (const double height : {0.0, 1.0}) {
    TriangleMesh fan = make_cone(25000, height, false);
    EXPECT_FALSE(*find_self_intersection(fan));
    for (Vec3d& p : fan.vertices) p = rotate(turn, p);
    EXPECT_FALSE(*find_self_intersection(fan));
    fan.vertices[2 + 7000] = fan.vertices[2 + 12000] * 0.9 + fan.vertices[0] * 0.1;
    EXPECT_TRUE(*find_self_intersection(fan));
  }
}

/// Needles side by side, all along (1, 2, 3): any two boxes along the axes overlap.
TEST(SelfIntersection, TiltedNeedlesAreFine) {
  const Quaternion turn = axis_angle({1, -2, 3}, 0.9);
  const int n = 100;
  TriangleMesh mesh;
  for (int i = 0; i < n * n; ++i) {
    const auto first = static_cast<std::uint32_t>(mesh.vertices.size());
    const Vec3d at{i % n * 1e-4, i / n * 1e-4, 0};
    for (const Vec3d& p : {Vec3d{4e-5, 0, 0}, {-2e-5, 3e-5, 0}, {-2e-5, -3e-5, 0}, {0, 0, 1}}) {
      mesh.vertices.push_back(rotate(turn, at + p));
    }
    for (const Triangle& t : {Triangle{0, 2, 1}, {0, 1, 3}, {1, 2, 3}, {2, 0, 3}}) {
      mesh.triangles.push_back({first + t[0], first + t[1], first + t[2]});
    }
  }
  const auto found = find_self_intersection(mesh);
  ASSERT_TRUE(found) << found.error().message;
  EXPECT_FALSE(*found);
  mesh.vertices[4 * 5050] = mesh.vertices[4 * 4040];
  EXPECT_TRUE(*find_self_intersection(mesh));
}

/// Both ends of a coin: thousands of thin faces around either middle.
TEST(SelfIntersection, CoinsAreFine) {
  const auto found = find_self_intersection(make_cylinder(0.01, 1e-4, 25000));
  ASSERT_TRUE(found) << found.error().message;
  EXPECT_FALSE(*found);
}

/// The two families of lines of z = x y, one of them raised: each line passes close by all of the
/// other family, and no box keeps them apart.
TEST(SelfIntersection, GivesUpOnFacesThatAllPassEachOther) {
  constexpr int kNum = 4000;
  constexpr double kWidth = 1e-6, kLift = 1e-5;
  TriangleMesh mesh;
  for (int i = 0; i < 2 * kNum; ++i) {
    const double x = i % kNum * 1.0 / kNum;
    const auto at = [&](double s, double t) {
      return i < kNum ? Vec3d{s, t, s * t} : Vec3d{t, s, s * t + kLift};
    };
    const auto first = static_cast<std::uint32_t>(mesh.vertices.size());
    mesh.vertices.insert(mesh.vertices.end(), {at(x, 0), at(x, 1), at(x + kWidth, 1)});
    mesh.triangles.push_back({first, first + 1, first + 2});
  }
  const auto found = find_self_intersection(mesh);
  ASSERT_FALSE(found);
  EXPECT_NE(found.error().message.find("too many faces side by side to be checked"),
            std::string::npos);
}

}  // namespace
}  // namespace palpate
