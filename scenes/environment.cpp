#include "scenes/environment.h"

#include <algorithm>
#include <limits>

#include "src/core/internal/assert.h"

namespace palpate { inline namespace v0 { namespace scenes {
namespace {

constexpr double kNever = std::numeric_limits<double>::quiet_NaN();

Plane<double> plane_through(const Vec3d& p, const Vec3d& normal) {
  return {normal, dot(normal, p)};
}

Plane<double> flipped(const Plane<double>& plane) { return {-plane.normal, -plane.offset}; }

SignedDistance negated(const SignedDistance& d) { return {-d.distance, -d.gradient}; }

double height(const Plane<double>& plane, const Vec3d& p) {
  return dot(plane.normal, p) - plane.offset;
}

/// Distance to the convex wedge behind both planes.
SignedDistance wedge_distance(const Plane<double>& a, const Plane<double>& b, const Vec3d& p) {
  const double da = height(a, p), db = height(b, p);
  if (da <= 0 && db <= 0) {
    return da > db ? SignedDistance{da, a.normal} : SignedDistance{db, b.normal};
  }
  // Outside, the nearest point is on a face if the foot of the perpendicular lies on the wedge ...
  const double c = dot(a.normal, b.normal);
  if (da > 0 && db - c * da <= 0) return {da, a.normal};
  if (db > 0 && da - c * db <= 0) return {db, b.normal};
  // ... and else on the edge. The way there is the combination of both normals with heights da, db.
  const double s2 = 1 - c * c;
  const Vec3d from_edge = a.normal * ((da - c * db) / s2) + b.normal * ((db - c * da) / s2);
  const double distance = norm(from_edge);
  return {distance, from_edge / distance};
}

SignedDistance ball_distance(const Vec3d& center, double radius, const Vec3d& p) {
  const Vec3d from_center = p - center;
  const double length = norm(from_center);
  const Vec3d direction = length > 0 ? from_center / length : Vec3d{0, 0, -1};
  return {length - radius, direction};
}

/// In B: the box around the origin.
SignedDistance box_distance(const Vec3d& half_size, const Vec3d& p) {
  std::size_t nearest = 0;
  Vec3d beyond, outward;
  for (std::size_t i = 0; i < 3; ++i) {
    beyond[i] = std::abs(p[i]) - half_size[i];
    outward[i] = p[i] < 0 ? -1 : 1;
    if (beyond[i] > beyond[nearest]) nearest = i;
  }
  if (beyond[nearest] <= 0) {
    Vec3d gradient;
    gradient[nearest] = outward[nearest];
    return {beyond[nearest], gradient};
  }
  for (std::size_t i = 0; i < 3; ++i) beyond[i] = std::max(0.0, beyond[i]) * outward[i];
  const double distance = norm(beyond);
  return {distance, beyond / distance};
}

/// Where a ray from the origin crosses the plane, going into the solid: its part before or after.
struct Interval {
  double enter = 0, leave = std::numeric_limits<double>::infinity();
};

void cut(Interval& ray, const Plane<double>& plane, const Vec3d& direction) {
  const double speed = dot(plane.normal, direction);
  const double t = plane.offset / speed;
  if (speed < 0) {
    ray.enter = std::max(ray.enter, t);
  } else if (speed > 0) {
    ray.leave = std::min(ray.leave, t);
  } else if (plane.offset < 0) {
    ray.leave = -1;
  }
}

double entry(const Interval& ray) { return ray.enter < ray.leave ? ray.enter : kNever; }

}  // namespace

Environment Environment::wall(double depth) {
  Environment environment;
  environment.a = {{0, 0, -1}, -depth};
  return environment;
}

Environment Environment::wedge(double depth, double opening) {
  PALPATE_ASSERT(opening > 0 && opening < 2 * kPi && opening != kPi);
  const double across = std::cos(opening / 2), along = -std::sin(opening / 2);
  Environment environment;
  environment.kind = opening < kPi ? Kind::ridge : Kind::corner;
  environment.a = plane_through({0, 0, depth}, {across, 0, along});
  environment.b = plane_through({0, 0, depth}, {-across, 0, along});
  return environment;
}

Environment Environment::ball_outside(double depth, double radius) {
  Environment environment;
  environment.kind = Kind::ball_outside;
  environment.center = {0, 0, depth + radius};
  environment.radius = radius;
  return environment;
}

Environment Environment::ball_inside(double depth, double radius) {
  Environment environment;
  environment.kind = Kind::ball_inside;
  environment.center = {0, 0, depth - radius};
  environment.radius = radius;
  return environment;
}

Environment Environment::box(const Pose& X_WB, const Vec3d& half_size) {
  Environment environment;
  environment.kind = Kind::box;
  environment.X_WB = X_WB;
  environment.half_size = half_size;
  return environment;
}

Environment Environment::in_frame(const Pose& X_FW) const {
  const auto moved = [&](const Plane<double>& plane) {
    const Vec3d normal = rotate(X_FW.rotation, plane.normal);
    return Plane<double>{normal, plane.offset + dot(normal, X_FW.translation)};
  };
  Environment there = *this;
  there.a = moved(a);
  there.b = moved(b);
  there.center = X_FW * center;
  there.X_WB = X_FW * X_WB;
  return there;
}

std::array<Plane<double>, 6> Environment::faces() const {
  std::array<Plane<double>, 6> faces;
  for (std::size_t i = 0; i < 6; ++i) {
    Vec3d normal_B;
    normal_B[i / 2] = i % 2 == 0 ? -1 : 1;
    faces[i] = plane_through(X_WB * (half_size[i / 2] * normal_B), rotate(X_WB.rotation, normal_B));
  }
  return faces;
}

SignedDistance signed_distance(const Environment& environment, const Vec3d& p) {
  const Plane<double>&a = environment.a, &b = environment.b;
  switch (environment.kind) {
    case Environment::Kind::half_space: return {height(a, p), a.normal};
    case Environment::Kind::ridge: return wedge_distance(a, b, p);
    case Environment::Kind::corner: return negated(wedge_distance(flipped(a), flipped(b), p));
    case Environment::Kind::ball_outside:
      return ball_distance(environment.center, environment.radius, p);
    case Environment::Kind::ball_inside:
      return negated(ball_distance(environment.center, environment.radius, p));
    case Environment::Kind::box: {
      const Pose& X_WB = environment.X_WB;
      const SignedDistance d = box_distance(environment.half_size, inverse(X_WB) * p);
      return {d.distance, rotate(X_WB.rotation, d.gradient)};
    }
  }
  return {};
}

double first_hit(const Environment& environment, const Vec3d& direction) {
  Interval first, second;
  switch (environment.kind) {
    case Environment::Kind::half_space: cut(first, environment.a, direction); return entry(first);
    case Environment::Kind::ridge:
      cut(first, environment.a, direction);
      cut(first, environment.b, direction);
      return entry(first);
    case Environment::Kind::corner:
      cut(first, environment.a, direction);
      cut(second, environment.b, direction);
      return std::fmin(entry(first), entry(second));
    case Environment::Kind::box:
      for (const Plane<double>& face : environment.faces()) cut(first, face, direction);
      return entry(first);
    case Environment::Kind::ball_outside:
    case Environment::Kind::ball_inside: break;
  }
  // |t d - c| = r; the nearer root enters the ball, the farther one leaves it.
  const double dd = dot(direction, direction), dc = dot(direction, environment.center);
  const double cc =
      dot(environment.center, environment.center) - environment.radius * environment.radius;
  const double discriminant = dc * dc - dd * cc;
  if (discriminant < 0) return kNever;
  const double root = std::sqrt(discriminant);
  const double t =
      (environment.kind == Environment::Kind::ball_outside ? dc - root : dc + root) / dd;
  return t > 0 ? t : kNever;
}

}}}  // namespace palpate::v0::scenes
