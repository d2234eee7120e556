// Matrices of bodies that touch: their mass, and how a contact's wrench and velocity at one center
// of mass are those at the other.
#pragma once

#include <cmath>

#include "src/bodies/internal/rigid_body.h"
#include "src/math/internal/matrix6.h"

namespace palpate { inline namespace v0 {

/// Adds s b to a.
inline void add(Mat6& a, double s, const Mat6& b) { a = sum(a, s, b); }

/// Returns T of v_at_a = T v: the velocity of the point at a's center of mass that moves with a
/// body whose own center of mass is `d` away from it.
inline Mat6 transport(const Vec3d& d) {
  Mat6 t;
  for (int i = 0; i < 6; ++i) t.m[i][i] = 1;
  t.m[0][4] = d.z;
  t.m[0][5] = -d.y;
  t.m[1][3] = -d.z;
  t.m[1][5] = d.x;
  t.m[2][3] = d.y;
  t.m[2][4] = -d.x;
  return t;
}

/// Returns the opposite of a wrench on a, about the center of mass of b; `d` leads from there to
/// that of a.
inline Vec6 at_other(const Vec6& wrench_a, const Vec3d& d) {
  return {-wrench_a.linear, -(wrench_a.angular + cross(d, wrench_a.linear))};
}

/// Returns the stiffness of the stiffest direction, too large by at most the square root of 3.
inline double largest(const double (&k)[6][6]) {
  double squares = 0;
  for (int i = 0; i < 3; ++i) {
    for (int j = 0; j < 3; ++j) squares += k[i][j] * k[i][j];
  }
  return std::sqrt(squares);
}

inline double radius_of_gyration(const RigidBody& body) {
  const auto& i = body.inertia_B.m;
  return std::sqrt((i[0][0] + i[1][1] + i[2][2]) / 2 / body.mass);
}

inline Mat6 mass_matrix(const RigidBody& body) {
  Mat6 mass;
  const Mat3d inertia = inertia_W(body);
  for (int i = 0; i < 3; ++i) {
    mass.m[i][i] = body.mass;
    for (int j = 0; j < 3; ++j) mass.m[i + 3][j + 3] = inertia.m[i][j];
  }
  return mass;
}

}}  // namespace palpate::v0
