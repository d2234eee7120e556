// Covers a solid with few spheres that may overlap. Candidates are the largest balls inside that
// touch the surface at a point: a ball shrinks until nothing of the surface is in it (Ma et al., 3D
// medial axis point approximation using nearest neighbors, 2012). Of these the one that reaches
// most points that none reaches yet is taken, again and again.
#include "src/packing/internal/sphere_cover.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <string>

#include "src/mesh/internal/surface_points.h"
#include "src/packing/solid/triangle_bvh.h"

namespace palpate { inline namespace v0 {
namespace {

constexpr int kCandidates = 1500;
constexpr int kWatched = 6000;          // points of the surface
constexpr double kAtSamples = 0.9;      // of the standoff: between the points it may be more
constexpr double kRounding = 1e-6;      // of the longest side: what is stored is strictly inside
constexpr std::size_t kCorners = 4000;  // of a mesh that are watched, too

/// Returns the largest ball inside that touches the surface at p; of radius 0 if there is none.
Sphere touching_ball(const TriangleBvh& surface, const Vec3d& p, double longest) {
  const auto at = surface.closest(p, longest);
  if (at.triangle < 0) return {};
  const Triangle& t = surface.triangle(at.triangle);
  const Vec3d inward = -normalized(cross(t.b - t.a, t.c - t.a));
  double radius = longest;
  Vec3d center = p;
  for (int round = 0; round < 30; ++round) {
    center = p + inward * radius;
    const auto hit = surface.closest(center, 2 * longest);
    if (hit.triangle < 0) return {};
    if (hit.distance >= radius * (1 - 1e-6)) break;
    const Vec3d to = hit.point - p;
    const double along = dot(to, inward);
    if (!(along > 0)) break;
    radius = std::min(radius, dot(to, to) / (2 * along));
  }
  const Vec3f stored = to_float(center);
  const Vec3d c = to_double(stored);
  if (!surface.inside(c)) return {};
  const double room = surface.closest(c, 2 * longest).distance;
  return {stored, static_cast<float>(std::max(0.0, room - kRounding * longest))};
}

std::vector<Vec3d> watched_points(const TriangleMesh& solid, int num) {
  std::vector<Vec3d> points = surface_points(solid, num);
  const std::size_t stride = 1 + solid.vertices.size() / kCorners;
  for (std::size_t i = 0; i < solid.vertices.size(); i += stride) {
    points.push_back(solid.vertices[i]);
  }
  return points;
}

double standoff_at(const Vec3d& p, const Sphere& sphere) {
  return norm(p - to_double(sphere.center)) - static_cast<double>(sphere.radius);
}

/// Adds balls where points are farther from all spheres than the standoff: the largest one that
/// touches the surface near the farthest of them and reaches it.
void close_gaps(const TriangleBvh& surface, double longest, const std::vector<Vec3d>& points,
                double standoff, int max_spheres, SpherePacking& cover) {
  constexpr int kTries = 60;
  std::vector<double> left(points.size(), std::numeric_limits<double>::infinity());
  const auto add = [&](const Sphere& sphere) {
    for (std::size_t k = 0; k < points.size(); ++k) {
      left[k] = std::min(left[k], standoff_at(points[k], sphere));
    }
  };
  for (const Sphere& sphere : cover.spheres) add(sphere);
  for (;;) {
    const auto worst = static_cast<std::size_t>(std::ranges::max_element(left) - left.begin());
    if (left[worst] <= standoff) return;
    if (cover.spheres.size() >= static_cast<std::size_t>(max_spheres)) {
      cover.stop = PackStop::count;
      return;
    }
    Sphere best;
    int num = 0;
    for (std::size_t k = 0; k < points.size() && num < kTries; ++k) {
      if (norm(points[k] - points[worst]) > standoff) continue;
      ++num;
      const Sphere ball = touching_ball(surface, points[k], longest);
      const bool reaches = standoff_at(points[worst], ball) <= kAtSamples * standoff;
      if (ball.radius > best.radius && reaches) best = ball;
    }
    if (best.radius > 0) {
      cover.spheres.push_back(best);
      add(best);
    } else {
      left[worst] = 0;  // too thin
      cover.stop = PackStop::exhausted;
    }
  }
}

}  // namespace

Result<SpherePacking> cover_solid(const TriangleMesh& solid, double standoff, int max_spheres) {
  if (!(standoff > 0 && std::isfinite(standoff)) || max_spheres < 1) {
    return Error{Errc::invalid_argument,
                 "a cover needs a standoff above 0 m and at least one sphere"};
  }
  const TriangleBvh surface(solid);
  const Bounds box = bounds(solid);
  const double longest = norm(box.high - box.low);
  std::vector<Sphere> balls;
  for (const Vec3d& p : surface_points(solid, kCandidates)) {
    const Sphere ball = touching_ball(surface, p, longest);
    if (ball.radius > 0) balls.push_back(ball);
  }
  if (balls.empty()) return Error{Errc::bad_input, "no sphere fits into the solid"};
  const std::vector<Vec3d> points = watched_points(solid, kWatched);
  std::vector<std::vector<std::uint32_t>> reached(balls.size());  // points of each ball
  std::vector<std::vector<std::uint32_t>> reaching(points.size());
  for (std::uint32_t i = 0; i < balls.size(); ++i) {
    for (std::uint32_t k = 0; k < points.size(); ++k) {
      if (standoff_at(points[k], balls[i]) > kAtSamples * standoff) continue;
      reached[i].push_back(k);
      reaching[k].push_back(i);
    }
  }
  SpherePacking cover{{}, mass_properties(solid).volume, PackStop::standoff};
  std::vector<std::size_t> gain(balls.size());
  std::ranges::transform(reached, gain.begin(), [](const auto& list) { return list.size(); });
  std::vector<bool> is_covered(points.size());
  for (;;) {
    const auto best = static_cast<std::size_t>(std::ranges::max_element(gain) - gain.begin());
    if (gain[best] == 0 && !cover.spheres.empty()) break;
    if (cover.spheres.size() == static_cast<std::size_t>(max_spheres)) {
      cover.stop = PackStop::count;
      break;
    }
    cover.spheres.push_back(balls[best]);
    for (const std::uint32_t k : reached[best]) {
      if (is_covered[k]) continue;
      is_covered[k] = true;
      for (const std::uint32_t i : reaching[k]) --gain[i];
    }
    gain[best] = 0;
  }
  close_gaps(surface, longest, watched_points(solid, kStandoffSamples), standoff, max_spheres,
             cover);
  return cover;
}

double farthest_standoff(const TriangleMesh& solid, std::span<const Sphere> spheres) {
  double farthest = 0;
  for (const Vec3d& p : watched_points(solid, kStandoffSamples)) {
    double least = std::numeric_limits<double>::infinity();
    for (const Sphere& sphere : spheres) least = std::min(least, standoff_at(p, sphere));
    farthest = std::max(farthest, least);
  }
  return farthest;
}

}}  // namespace palpate::v0
