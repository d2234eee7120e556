// Random disjoint spheres for tests: not a good packing, but an honest one.
#pragma once

#include <cstdint>
#include <random>
#include <vector>

#include "palpate/math/geometry.h"

namespace palpate::test {

/// Random sequential addition in a box of 10 cm: radii span a factor of 30, small ones are most
/// common, and every second one grows until it nearly touches what is there. O(n^2).
inline std::vector<Sphere> random_packing(int count, std::uint64_t seed, Vec3d origin = {}) {
  std::mt19937_64 random(seed);
  std::uniform_real_distribution<double> unit(0, 1);
  const double largest = 0.03 / std::cbrt(static_cast<double>(count));
  std::vector<Sphere> spheres;
  while (static_cast<int>(spheres.size()) < count) {
    const Vec3f center = to_float(Vec3d{unit(random), unit(random), unit(random)} * 0.1 + origin);
    double room = largest * std::pow(30.0, -unit(random));
    for (const Sphere& other : spheres) {
      const double distance = norm(to_double(other.center) - to_double(center));
      room = std::min(room, distance - double(other.radius));
    }
    const double share = unit(random) < 0.5 ? 0.999999 : unit(random);
    if (room > largest / 30) spheres.push_back({center, static_cast<float>(room * share)});
  }
  return spheres;
}

/// Touching neighbors on a square lattice: many equal gaps, to try the breaking of ties.
inline std::vector<Sphere> lattice(int per_side, float spacing, float radius) {
  std::vector<Sphere> spheres;
  for (int i = 0; i < per_side * per_side * per_side; ++i) {
    const int x = i % per_side, y = i / per_side % per_side, z = i / per_side / per_side;
    spheres.push_back({{spacing * float(x), spacing * float(y), spacing * float(z)}, radius});
  }
  return spheres;
}

}  // namespace palpate::test
