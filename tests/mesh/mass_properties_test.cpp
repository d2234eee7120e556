// Mass properties against closed forms, under rigid motion and by sampling.
#include "palpate/mesh/mesh.h"

#include <cmath>
#include <random>
#include <vector>

#include <gtest/gtest.h>

#include "palpate/math/geometry.h"

namespace palpate {
namespace {

void expect_near(const Mat3d& a, const Mat3d& b, double tolerance) {
  for (int i = 0; i < 3; ++i) {
    for (int j = 0; j < 3; ++j) EXPECT_NEAR(a.m[i][j], b.m[i][j], tolerance) << i << " " << j;
  }
}

void expect_near(const Vec3d& a, const Vec3d& b, double tolerance) {
  EXPECT_LE(norm(a - b), tolerance) << a.x << " " << a.y << " " << a.z;
}

/// R I R^T.
Mat3d rotated(const Mat3d& inertia, const Quaternion& q) {
  const Mat3d r = rotation_matrix(q);
  Mat3d result;
  for (int i = 0; i < 3; ++i) {
    for (int j = 0; j < 3; ++j) {
      for (int k = 0; k < 3; ++k) {
        for (int l = 0; l < 3; ++l) result.m[i][j] += r.m[i][k] * inertia.m[k][l] * r.m[j][l];
      }
    }
  }
  return result;
}

TriangleMesh moved(TriangleMesh mesh, const Pose& pose) {
  for (Vec3d& p : mesh.vertices) p = pose * p;
  return mesh;
}

TEST(MassProperties, Box) {
  const double a = 0.1, b = 0.2, c = 0.3, m = a * b * c;
  const MassProperties box = mass_properties(make_box({a, b, c}));
  EXPECT_NEAR(box.volume, m, 1e-17);
  expect_near(box.center_of_mass, {}, 1e-16);
  expect_near(box.inertia,
              {{{m / 12 * (b * b + c * c), 0, 0},
                {0, m / 12 * (a * a + c * c), 0},
                {0, 0, m / 12 * (a * a + b * b)}}},
              1e-18);
}

TEST(MassProperties, RegularSolidsAreIsotropic) {
  const double e = 0.1;
  const MassProperties tetrahedron = mass_properties(make_tetrahedron(e));
  const double t = tetrahedron.volume * e * e / 20;
  expect_near(tetrahedron.inertia, {{{t, 0, 0}, {0, t, 0}, {0, 0, t}}}, 1e-20);
  const MassProperties octahedron = mass_properties(make_octahedron(e * std::sqrt(2.0)));
  const double o = octahedron.volume * e * e / 10;
  expect_near(octahedron.inertia, {{{o, 0, 0}, {0, o, 0}, {0, 0, o}}}, 1e-20);
}

TEST(MassProperties, CylinderAndBallConverge) {
  const double r = 0.03, h = 0.2;
  const MassProperties cylinder = mass_properties(make_cylinder(r, h, 2000));
  const double m = kPi * r * r * h;
  EXPECT_NEAR(cylinder.volume / m, 1, 1e-5);
  EXPECT_NEAR(cylinder.inertia.m[2][2] / (m * r * r / 2), 1, 1e-5);
  EXPECT_NEAR(cylinder.inertia.m[0][0] / (m * (3 * r * r + h * h) / 12), 1, 1e-5);
  const MassProperties ball = mass_properties(make_icosphere(r, 6));
  EXPECT_NEAR(ball.inertia.m[1][1] / (0.4 * sphere_volume(r) * r * r), 1, 1e-3);
}

TEST(MassProperties, FollowRigidMotionAlsoFarFromTheOrigin) {
  std::mt19937 random(7);
  std::uniform_real_distribution<double> uniform(-1, 1);
  const TriangleMesh mesh = make_stylus(0.02, 0.15, 0.05, 17);
  const MassProperties still = mass_properties(mesh);
  for (const double distance : {0.0, 1.0, 1e3}) {
    const Pose pose{Vec3d{uniform(random), uniform(random), uniform(random)} * distance,
                    axis_angle({uniform(random), uniform(random), uniform(random)}, 2.0)};
    const MassProperties there = mass_properties(moved(mesh, pose));
    // The vertices themselves are rounded to 1e-16 of their distance.
    const double relative = 1e-13 + 1e-14 * distance / 0.02;
    EXPECT_NEAR(there.volume / still.volume, 1, relative);
    expect_near(there.center_of_mass, pose * still.center_of_mass, 1e-15 + 1e-15 * distance);
    expect_near(there.inertia, rotated(still.inertia, pose.rotation),
                relative * still.inertia.m[0][0]);
  }
}

TEST(MassProperties, CavitiesCountNegative) {
  TriangleMesh mesh = make_box({0.2, 0.2, 0.2});
  const TriangleMesh hole = make_box({0.1, 0.1, 0.1});
  for (const auto& t : hole.triangles) mesh.triangles.push_back({t[0] + 8, t[2] + 8, t[1] + 8});
  mesh.vertices.insert(mesh.vertices.end(), hole.vertices.begin(), hole.vertices.end());
  const MassProperties hollow = mass_properties(mesh);
  EXPECT_NEAR(hollow.volume, 0.007, 1e-17);
  EXPECT_NEAR(hollow.inertia.m[0][0], (0.008 * 0.04 - 0.001 * 0.01) / 6, 1e-18);
}

TEST(MassProperties, OfOneBall) {
  const std::vector<Sphere> spheres = {{{1, 2, 3}, 0.5f}};
  const MassProperties ball = mass_properties(spheres);
  const double i = 0.4 * sphere_volume(0.5) * 0.25;
  EXPECT_DOUBLE_EQ(ball.volume, sphere_volume(0.5));
  expect_near(ball.center_of_mass, {1, 2, 3}, 1e-15);
  expect_near(ball.inertia, {{{i, 0, 0}, {0, i, 0}, {0, 0, i}}}, 1e-15);
}

TEST(MassProperties, OfDisjointBallsEqualsTheirMeshes) {
  const std::vector<Sphere> spheres = {
      {{0.1f, 0, 0.02f}, 0.03f}, {{0, 0.2f, 0}, 0.05f}, {{0.05f, -0.1f, 0.3f}, 0.02f}};
  TriangleMesh mesh;
  for (const Sphere& sphere : spheres) {
    const auto first = static_cast<std::uint32_t>(mesh.vertices.size());
    const TriangleMesh ball = make_icosphere(sphere.radius, 6);
    for (const Vec3d& p : ball.vertices) mesh.vertices.push_back(p + to_double(sphere.center));
    for (const auto& t : ball.triangles) {
      mesh.triangles.push_back({first + t[0], first + t[1], first + t[2]});
    }
  }
  const MassProperties exact = mass_properties(spheres), meshed = mass_properties(mesh);
  EXPECT_NEAR(meshed.volume / exact.volume, 1, 1e-3);
  expect_near(meshed.center_of_mass, exact.center_of_mass, 1e-6);
  expect_near(meshed.inertia, exact.inertia, 1e-3 * exact.inertia.m[0][0]);
}

TEST(MassProperties, OfNothingIsZero) {
  EXPECT_EQ(mass_properties(TriangleMesh{}).volume, 0);
  EXPECT_EQ(mass_properties(std::vector<Sphere>{}).volume, 0);
  EXPECT_EQ(mass_properties(std::vector<Sphere>{}).center_of_mass, Vec3d{});
}

}  // namespace
}  // namespace palpate
