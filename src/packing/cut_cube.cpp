#include "src/packing/cut_cube.h"

#include <algorithm>
#include <cmath>

namespace palpate {
namespace {

constexpr double kLeastTilt = 1e-4;
constexpr double kTouch = 1 + 1e-9;

}  // namespace

// Inclusion and exclusion of the corners cut off the octant a.x <= t: volume of {x in [0,1]^3}
// = sum over corners v of (-1)^|v| max(0, t - a.v)^3 / (6 a_x a_y a_z).
double fraction_behind(const Cube& cube, const Vec3d& normal, double offset) {
  Vec3d a{std::abs(normal.x), std::abs(normal.y), std::abs(normal.z)};
  const double largest = std::max({a.x, a.y, a.z});
  if (!(largest > 0)) return offset >= 0 ? 1 : 0;
  for (int k = 0; k < 3; ++k) a[k] = std::max(a[k] / largest, kLeastTilt);
  const double sum = a.x + a.y + a.z;
  const double t = offset / (2 * cube.half * largest) + sum / 2;
  if (t <= 0) return 0;
  if (t >= sum) return 1;
  double volume = 0;
  for (int corner = 0; corner < 8; ++corner) {
    const int x = corner & 1, y = corner >> 1 & 1, z = corner >> 2;
    const double rest = std::max(0.0, t - x * a.x - y * a.y - z * a.z);
    volume += ((x + y + z) % 2 == 0 ? 1 : -1) * rest * rest * rest;
  }
  return std::clamp(volume / (6 * a.x * a.y * a.z), 0.0, 1.0);
}

bool overlaps(const Cube& cube, const Triangle& triangle) {
  const double s = cube.half * kTouch;
  const Vec3d v[3] = {triangle.a - cube.centre, triangle.b - cube.centre, triangle.c - cube.centre};
  for (int k = 0; k < 3; ++k) {
    const auto [low, high] = std::minmax({v[0][k], v[1][k], v[2][k]});
    if (low > s || high < -s) return false;
  }
  const Vec3d edges[3] = {v[1] - v[0], v[2] - v[1], v[0] - v[2]};
  const Vec3d n = cross(edges[0], edges[1]);
  if (std::abs(dot(n, v[0])) > s * (std::abs(n.x) + std::abs(n.y) + std::abs(n.z))) return false;
  for (const Vec3d& e : edges) {
    for (const Vec3d& axis : {Vec3d{0, -e.z, e.y}, Vec3d{e.z, 0, -e.x}, Vec3d{-e.y, e.x, 0}}) {
      const auto [low, high] = std::minmax({dot(axis, v[0]), dot(axis, v[1]), dot(axis, v[2])});
      const double reach = s * (std::abs(axis.x) + std::abs(axis.y) + std::abs(axis.z));
      if (low > reach || high < -reach) return false;
    }
  }
  return true;
}

// Moeller and Trumbore 1997.
bool crosses(const Vec3d& p, const Vec3d& q, const Triangle& triangle) {
  const Vec3d direction = q - p, e1 = triangle.b - triangle.a, e2 = triangle.c - triangle.a;
  const Vec3d h = cross(direction, e2);
  const double det = dot(e1, h);
  if (det == 0) return false;
  const Vec3d s = p - triangle.a, g = cross(s, e1);
  const double u = dot(s, h) / det, v = dot(direction, g) / det, t = dot(e2, g) / det;
  return u >= 0 && v >= 0 && u + v <= 1 && t >= 0 && t < 1;
}

}  // namespace palpate
