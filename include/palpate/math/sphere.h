// Spheres, planes and the part of a sphere behind a plane.
#pragma once

#include "palpate/math/vec3.h"

namespace palpate {

inline constexpr double kPi = 3.14159265358979323846;

/// A ball in the tool frame, single precision: the stored numbers are the truth that every check
/// and every backend uses.
struct Sphere {
  Vec3f centre;
  float radius = 0;
};

/// Points x with normal . x = offset. `normal` is unit and points out of the environment.
template <class T>
struct Plane {
  Vec3<T> normal;
  T offset{};
};

/// 4/3 pi r^3.
template <class Real>
PALPATE_HOSTDEV constexpr Real sphere_volume(Real radius) {
  return Real(4.0 / 3.0 * kPi) * radius * radius * radius;
}

/// Volume of the part of a ball of radius r that lies behind a plane, d being the *signed* distance
/// of the centre in front of it (thesis Alg. 3.1 and eq. 3.1; d = n.(c - p) with |n| = 1, eq. 3.2
/// corrected). 0 for d >= r, the whole ball for d <= -r. Branch-free after the clamp.
template <class Real>
PALPATE_HOSTDEV constexpr Real cap_volume(Real radius, Real distance) {
  const Real h_raw = radius - distance;
  const Real h_low = h_raw < Real(0) ? Real(0) : h_raw;
  const Real h = h_low > radius + radius ? radius + radius : h_low;
  return Real(kPi / 3.0) * h * h * (Real(3) * radius - h);
}

/// Volume common to two balls with centres `distance` apart (theory: lens of two caps).
template <class Real>
PALPATE_HOSTDEV constexpr Real lens_volume(Real a, Real b, Real distance) {
  const Real small = a < b ? a : b, large = a < b ? b : a;
  if (distance >= a + b) return Real(0);
  if (distance <= large - small) return sphere_volume(small);
  const Real s = a + b - distance, diff = a - b;
  return Real(kPi / 12.0) * s * s *
         (distance * distance + Real(2) * distance * (a + b) - Real(3) * diff * diff) / distance;
}

}  // namespace palpate
