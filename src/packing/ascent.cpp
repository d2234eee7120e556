#include "src/packing/ascent.h"

#include <algorithm>
#include <cmath>
#include <limits>

namespace palpate { inline namespace v0 {
namespace {

constexpr int kMaxSteps = 32;     // among known obstacles
constexpr int kMaxMeetings = 64;  // steps, and obstacles met, when looking for them on the way
constexpr double kEnough = 0.5;   // of the promised gain: otherwise the obstacle met joins first

// Distances to the mesh may be off by this fraction where many triangles are about equally near.
constexpr double kTolerance = 1e-3;

constexpr int kMaxShrinks = 24;
// An obstacle may be so near to the center of a tangent ball, as fraction of the radius.
constexpr double kTouching = 1 - 1e-3;

// Half side of the box one step may move in, as fraction of the clearance. Below 1/sqrt(3) the new
// center lies in the old ball, so no step can jump through a wall.
constexpr double kStep = 0.5;

// An obstacle farther than this times the clearance cannot matter within one step.
constexpr double kHorizon = 1 + 2 * 1.7320508075688773 * kStep;

// Gains, as fraction of the radius: one that is not worth a step, and one after which convergence
// makes another step pointless.
constexpr double kNoGain = 1e-7;
constexpr double kLastGain = 1e-4;

}  // namespace

double FreeSpace::clearance(const Vec3d& p, double reach) const {
  const double free = spheres.clearance(p, reach);
  if (free <= 0) return free;
  return std::min(free, mesh.closest(p, free).distance);
}

FreeSpace::Nearest FreeSpace::nearest(const Vec3d& p, double reach) const {
  Nearest result;
  result.distance = spheres.nearest(p, reach, result.sphere);
  if (result.distance <= 0) return result;
  const auto closest = mesh.closest(p, result.distance, kTolerance);
  if (closest.triangle >= 0) return {closest.distance, {}, closest.triangle, closest.point};
  return result;
}

// A ball that is too large shrinks until it only touches what was in its way (Ma, Bae and Choi
// 2012): |n q - v| = R + q for an obstacle of radius R at v, seen from p, gives q = (v.v - R^2) /
// 2(v.n + R). A wall right at p can be overlooked, hence the last check.
Ball FreeSpace::tangent_ball(const Vec3d& p, const Vec3d& n, double radius) const {
  for (int i = 0; i < kMaxShrinks; ++i) {
    const Vec3d center = p + n * radius;
    const Nearest found = nearest(center, radius * kTouching);
    const bool is_sphere = found.sphere.radius > 0;
    if (!is_sphere && found.triangle < 0) {
      return mesh.inside(center) ? Ball{center, radius * kTouching} : Ball{};
    }
    const Vec3d v = (is_sphere ? to_double(found.sphere.center) : found.point) - p;
    const double big = found.sphere.radius, length = norm(v);
    const double free = (length - big) * (length + big) / (2 * (dot(v, n) + big));
    if (!(free > 0)) break;
    radius = std::min(radius * kTouching, free);
  }
  return {};
}

bool FreeSpace::gather(const Vec3d& p, double clearance, double reach, std::size_t limit,
                       Obstacles& obstacles) const {
  obstacles.center = p;
  double excess = reach - clearance;
  for (int attempt = 0; attempt < 2; ++attempt, excess *= 0.4) {
    obstacles.reach = clearance + excess;
    obstacles.spheres.clear();
    obstacles.triangles.clear();
    if (mesh.gather(p, obstacles.reach, limit, obstacles.triangles) &&
        spheres.gather(p, obstacles.reach, limit, obstacles.spheres)) {
      return true;
    }
  }
  return false;
}

double Ascent::measure(const Obstacles& obstacles, const Vec3d& p) {
  distance_.clear();
  away_.clear();
  double least = std::numeric_limits<double>::infinity();
  const auto add = [&](const Vec3d& from, double radius) {
    const Vec3d v = p - from;
    const double length = norm(v), distance = length - radius;
    distance_.push_back(distance);
    away_.push_back(v * (1 / length));
    least = std::min(least, distance);
  };
  for (const Sphere& s : obstacles.spheres) add(to_double(s.center), s.radius);
  for (int t : obstacles.triangles) add(closest_point(space_.mesh.triangle(t), p), 0);
  return least;
}

// Returns false when the ball has grown out of the reach of the obstacles: then its radius is only
// an upper bound.
bool Ascent::climb_within(const Obstacles& obstacles, Ball& ball) {
  ball.radius = measure(obstacles, ball.center);
  for (int step = 0; step < kMaxSteps; ++step) {
    if (ball.radius >= space_.max_radius || !(ball.radius > 0)) return true;
    constraints_.clear();
    const double horizon = kHorizon * ball.radius;
    for (std::size_t i = 0; i < distance_.size(); ++i) {
      if (distance_[i] <= horizon) constraints_.add(away_[i], distance_[i]);
    }
    const LinearOptimum best = solve_linear_program(constraints_, kStep * ball.radius);
    const double gain = best.t - ball.radius;
    if (gain <= kNoGain * ball.radius) return true;
    const Vec3d center = ball.center + best.d;
    const double known = obstacles.reach - norm(center - obstacles.center);
    const double radius = measure(obstacles, center);
    if (radius > known) {
      if (known > ball.radius) ball = {center, radius};
      return false;
    }
    if (radius <= ball.radius) return true;
    ball = {center, radius};
    if (gain <= kLastGain * radius) return true;
  }
  return true;
}

// Only the obstacles that were ever in the way take part: whenever a step falls short of what the
// linear program promised, the obstacle it met joins them.
Ball Ascent::climb(const Vec3d& start, double reach, const Tether* tether) {
  obstacles_.spheres.clear();
  obstacles_.triangles.clear();
  Ball ball{start, meet(start, reach)};
  for (int step = 0; step < kMaxMeetings; ++step) {
    if (ball.radius >= space_.max_radius || !(ball.radius > 0)) break;
    measure(obstacles_, ball.center);
    constraints_.clear();
    for (std::size_t i = 0; i < distance_.size(); ++i) constraints_.add(away_[i], distance_[i]);
    const LinearOptimum best = solve_linear_program(constraints_, kStep * ball.radius);
    const double gain = best.t - ball.radius;
    if (gain <= kNoGain * ball.radius) break;
    const Vec3d center = ball.center + best.d;
    const double radius = meet(center, ball.radius + 1.001 * norm(best.d));
    if (radius < ball.radius + kEnough * gain) continue;
    if (tether != nullptr && norm(center - tether->place) - radius > tether->length) break;
    ball = {center, radius};
    if (gain <= kLastGain * radius) break;
  }
  ball.radius = std::min(ball.radius, space_.max_radius);
  return ball;
}

// The clearance of p; the obstacle that limits it joins obstacles_.
double Ascent::meet(const Vec3d& p, double reach) {
  const FreeSpace::Nearest found = space_.nearest(p, reach);
  if (found.triangle >= 0) {
    obstacles_.triangles.push_back(found.triangle);
  } else if (found.sphere.radius > 0) {
    obstacles_.spheres.push_back(found.sphere);
  }
  return found.distance;
}

Ball Ascent::climb(const Vec3d& start, const Obstacles& obstacles) {
  Ball ball{start, 0};
  if (climb_within(obstacles, ball)) {
    ball.radius = std::min(ball.radius, space_.max_radius);
    return ball;
  }
  return climb(ball.center, ball.radius);
}

}}  // namespace palpate::v0
