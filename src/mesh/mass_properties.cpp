#include "palpate/mesh/mesh.h"

#include <algorithm>

namespace palpate { inline namespace v0 {
namespace {

/// weight * x x^T is added to m.
void add_outer_product(Mat3d& m, const Vec3d& x, double weight) {
  for (int i = 0; i < 3; ++i) {
    for (int j = 0; j < 3; ++j) m.m[i][j] += weight * (x[i] * x[j]);
  }
}

/// Inertia tr(C) I - C of a body whose second moments, the integrals of x_i x_j, are C.
Mat3d inertia_of(const Mat3d& second_moments) {
  const auto& c = second_moments.m;
  const double trace = c[0][0] + c[1][1] + c[2][2];
  Mat3d inertia;
  for (int i = 0; i < 3; ++i) {
    for (int j = 0; j < 3; ++j) inertia.m[i][j] = (i == j ? trace : 0.0) - c[i][j];
  }
  return inertia;
}

}  // namespace

// The solid is the signed sum of the tetrahedra that its faces span with one reference point. The
// reference lies in the middle of the mesh, so that a mesh far from the origin loses no digits.
MassProperties mass_properties(const TriangleMesh& mesh) {
  const Bounds box = bounds(mesh);
  const Vec3d reference = box.low + (box.high - box.low) * 0.5;

  double volume = 0;
  Vec3d first_moment;
  Mat3d second_moments;
  for (const auto& triangle : mesh.triangles) {
    const Vec3d a = mesh.vertices[triangle[0]] - reference;
    const Vec3d b = mesh.vertices[triangle[1]] - reference;
    const Vec3d c = mesh.vertices[triangle[2]] - reference;
    const Vec3d sum = a + b + c;
    const double tetrahedron = dot(a, cross(b, c)) / 6;
    volume += tetrahedron;
    first_moment += sum * (tetrahedron / 4);
    for (const Vec3d& x : {a, b, c, sum}) add_outer_product(second_moments, x, tetrahedron / 20);
  }
  const Vec3d offset = volume != 0 ? first_moment / volume : Vec3d{};
  add_outer_product(second_moments, offset, -volume);
  return {volume, reference + offset, inertia_of(second_moments)};
}

MassProperties mass_properties(std::span<const Sphere> spheres) {
  double volume = 0;
  Vec3d first_moment;
  for (const Sphere& sphere : spheres) {
    const double mass = sphere_volume(static_cast<double>(sphere.radius));
    volume += mass;
    first_moment += to_double(sphere.center) * mass;  // Thesis eq. 3.4.
  }
  const Vec3d center = volume > 0 ? first_moment / volume : Vec3d{};

  // Thesis eqs. 3.5 and 3.6: a ball's own inertia 2/5 m r^2 I has the second moments 1/5 m r^2 I.
  Mat3d second_moments;
  for (const Sphere& sphere : spheres) {
    const double radius = sphere.radius;
    const double mass = sphere_volume(radius);
    add_outer_product(second_moments, to_double(sphere.center) - center, mass);
    for (int i = 0; i < 3; ++i) second_moments.m[i][i] += mass * radius * radius / 5;
  }
  return {volume, center, inertia_of(second_moments)};
}

Bounds bounds(const TriangleMesh& mesh) {
  if (mesh.vertices.empty()) return {};
  Bounds box{mesh.vertices.front(), mesh.vertices.front()};
  for (const Vec3d& p : mesh.vertices) {
    for (int axis = 0; axis < 3; ++axis) {
      box.low[axis] = std::min(box.low[axis], p[axis]);
      box.high[axis] = std::max(box.high[axis], p[axis]);
    }
  }
  return box;
}

}}  // namespace palpate::v0
