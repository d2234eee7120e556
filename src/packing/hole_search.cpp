#include "src/packing/hole_search.h"

#include <algorithm>
#include <array>
#include <cmath>

namespace palpate { inline namespace v0 {
namespace {

constexpr std::size_t kNumDirections = 96;  // a multiple of the vector width
constexpr std::size_t kMaxObstacles = 512;
constexpr double kReach = 3;       // of the sphere's radius: room for holes as large as the sphere
constexpr double kSameHole = 0.2;  // of the radius: closer balls are one hole

// Directions on a Fibonacci spiral and the neighbors of each.
struct Directions {
  std::array<float, kNumDirections> x, y, z;
  std::array<std::vector<std::size_t>, kNumDirections> neighbors;

  Directions() {
    const double golden = kPi * (3 - std::sqrt(5.0));
    for (std::size_t i = 0; i < kNumDirections; ++i) {
      const double height = 1 - (2 * static_cast<double>(i) + 1) / kNumDirections;
      const double radius = std::sqrt(1 - height * height), angle = golden * static_cast<double>(i);
      x[i] = static_cast<float>(radius * std::cos(angle));
      y[i] = static_cast<float>(radius * std::sin(angle));
      z[i] = static_cast<float>(height);
    }
    // 1.5 times the mean spacing sqrt(4 pi / n).
    const double near = std::cos(1.5 * std::sqrt(4 * kPi / kNumDirections));
    for (std::size_t i = 0; i < kNumDirections; ++i) {
      for (std::size_t j = 0; j < kNumDirections; ++j) {
        const double cosine = static_cast<double>(x[i] * x[j] + y[i] * y[j] + z[i] * z[j]);
        if (i != j && cosine > near) neighbors[i].push_back(j);
      }
    }
  }
};

const Directions& directions() {
  static const Directions instance;
  return instance;
}

}  // namespace

// With w the way to the obstacle's center, R its radius and unit radius of the sphere, the touching
// ball of radius q in direction u satisfies |(1 + q) u - w| = R + q, hence
// q = (|w|^2 - 2 u.w + 1 - R^2) / (2 (u.w - 1 + R)); with no positive denominator it never touches.
void HoleSearch::touch_sphere(const Sphere& sphere, const Sphere& obstacle) {
  const Vec3d w = to_double(obstacle.center) - to_double(sphere.center);
  if (w == Vec3d{}) return;  // the sphere itself
  const double unit = 1 / static_cast<double>(sphere.radius);
  const double length = norm(w) * unit, big = static_cast<double>(obstacle.radius) * unit;
  const Vec3f v = to_float(w * unit);
  const float a = static_cast<float>((length - big) * (length + big) + 1);
  const float b = static_cast<float>(big - 1);
  const Directions& u = directions();
  for (std::size_t i = 0; i < kNumDirections; ++i) {
    const float along = u.x[i] * v.x + u.y[i] * v.y + u.z[i] * v.z;
    const float top = a - 2 * along, bottom = 2 * (along + b);
    const float q = top / (bottom > 1e-6f ? bottom : 1e-6f);
    radius_[i] = q < radius_[i] ? q : radius_[i];
  }
}

// A convex obstacle lies behind the plane through its closest point; a triangle also lies in its
// own plane. The ball touches the plane u.x = f at q = (f - u.m) / (1 + u.m). Both planes are safe,
// so the more generous one counts.
void HoleSearch::touch_triangle(const Sphere& sphere, const Triangle& triangle) {
  const Vec3d p = to_double(sphere.center);
  const double unit = 1 / static_cast<double>(sphere.radius);
  const Vec3d w = closest_point(triangle, p) - p;
  const double length = norm(w);
  const Vec3f m = to_float(w / length);
  const float f = static_cast<float>(std::max(1.0, length * unit));
  Vec3d normal = normalized(cross(triangle.b - triangle.a, triangle.c - triangle.a));
  double height = dot(normal, triangle.a - p);
  if (height < 0) normal = -normal, height = -height;
  const bool facing = height * unit >= 0.999;
  const Vec3f n = facing ? to_float(normal) : m;
  const float g = facing ? static_cast<float>(std::max(1.0, height * unit)) : f;
  const Directions& u = directions();
  for (std::size_t i = 0; i < kNumDirections; ++i) {
    const float um = u.x[i] * m.x + u.y[i] * m.y + u.z[i] * m.z;
    const float un = u.x[i] * n.x + u.y[i] * n.y + u.z[i] * n.z;
    const float qm = (f - um) / (1.000001f + um), qn = (g - un) / (1.000001f + un);
    const float q = qm > qn ? qm : qn;
    radius_[i] = q < radius_[i] ? q : radius_[i];
  }
}

// All directions at once against the obstacles nearby; false if these are too many.
bool HoleSearch::measure_directions(const Sphere& sphere) {
  const double r = sphere.radius;
  if (!space_.gather(to_double(sphere.center), r, kReach * r, kMaxObstacles, obstacles_)) {
    return false;
  }
  const double most = std::min((obstacles_.reach - r) / 2, space_.max_radius);
  radius_.assign(kNumDirections, static_cast<float>(most / r));
  for (const Sphere& obstacle : obstacles_.spheres) touch_sphere(sphere, obstacle);
  for (int t : obstacles_.triangles) touch_triangle(sphere, space_.mesh.triangle(t));
  return true;
}

// One direction after the other, looking for the obstacle in its way.
void HoleSearch::probe_directions(const Sphere& sphere) {
  const double r = sphere.radius;
  const Directions& u = directions();
  radius_.resize(kNumDirections);
  for (std::size_t i = 0; i < kNumDirections; ++i) {
    const Vec3d n = to_double(Vec3f{u.x[i], u.y[i], u.z[i]});
    const Ball ball =
        space_.tangent_ball(to_double(sphere.center) + n * r, n, std::min(r, space_.max_radius));
    radius_[i] = static_cast<float>(ball.radius / r);
  }
}

void HoleSearch::find(const Sphere& sphere, double min_radius, std::vector<Ball>& holes) {
  const Vec3d p = to_double(sphere.center);
  const double r = sphere.radius;
  const bool measured = measure_directions(sphere);
  if (!measured) probe_directions(sphere);

  const Directions& u = directions();
  const std::size_t first = holes.size();
  for (std::size_t i = 0; i < kNumDirections; ++i) {
    const double q = static_cast<double>(radius_[i]);
    if (q * r * 2 < min_radius) continue;
    const bool peak =
        std::none_of(u.neighbors[i].begin(), u.neighbors[i].end(), [&](std::size_t j) {
          return radius_[j] > radius_[i] || (radius_[j] == radius_[i] && j < i);
        });
    if (!peak) continue;
    const Vec3d direction = to_double(Vec3f{u.x[i], u.y[i], u.z[i]});
    const Vec3d start = p + direction * (r + q * r);
    const Ball hole =
        measured ? ascent_.climb(start, obstacles_) : ascent_.climb(start, 1.1 * q * r);
    if (hole.radius < min_radius) continue;
    const bool known = std::any_of(
        holes.begin() + static_cast<std::ptrdiff_t>(first), holes.end(), [&](const Ball& other) {
          return norm(other.center - hole.center) < kSameHole * hole.radius;
        });
    if (!known) holes.push_back(hole);
  }
}

}}  // namespace palpate::v0
