// Everything here rests on one idea. Seen from an apex, a closed mesh is a signed sum of cones, one
// over each triangle. If every surface of the environment looks edge-on from the apex (planes
// through it) or is a sphere around it, cutting the cones cuts the solid and no cap has to be
// constructed.
#include "scenes/truth.h"

#include <algorithm>
#include <array>
#include <span>

namespace palpate::scenes {
namespace {

using Triangle = std::array<Vec3d, 3>;

/// Calls visit(triangle in W) for all faces.
template <class Visit>
void for_each_triangle(const TriangleMesh& mesh, const Pose& X_WT, Visit visit) {
  const Mat3d R_WT = rotation_matrix(X_WT.rotation);
  const auto corner = [&](std::uint32_t i) { return R_WT * mesh.vertices[i] + X_WT.translation; };
  for (const auto& [a, b, c] : mesh.triangles) visit(Triangle{corner(a), corner(b), corner(c)});
}

/// Volume and first moment (integral of x), the latter relative to the apex.
struct Moments {
  double volume = 0;
  Vec3d first;
};

Plane<double> flipped(const Plane<double>& plane) { return {-plane.normal, -plane.offset}; }

/// A triangle cut by at most three planes has at most six corners.
class Polygon {
 public:
  explicit Polygon(const Triangle& t) : size_(3) {
    std::copy(t.begin(), t.end(), corners_.begin());
  }

  /// Keeps what lies behind the plane (Sutherland & Hodgman).
  void clip(const Plane<double>& plane) {
    const std::array<Vec3d, kCapacity> old = corners_;
    const std::size_t old_size = size_;
    size_ = 0;
    for (std::size_t i = 0; i < old_size; ++i) {
      const Vec3d &p = old[i], &q = old[i + 1 < old_size ? i + 1 : 0];
      const double hp = dot(plane.normal, p) - plane.offset;
      const double hq = dot(plane.normal, q) - plane.offset;
      if (hp <= 0) corners_[size_++] = p;
      if ((hp < 0 && hq > 0) || (hp > 0 && hq < 0))
        corners_[size_++] = p + (q - p) * (hp / (hp - hq));
    }
  }

  /// Of the cone over the polygon.
  void add_cone(const Vec3d& apex, Moments& sum) const {
    for (std::size_t i = 2; i < size_; ++i) {
      const Vec3d a = corners_[0] - apex, b = corners_[i - 1] - apex, c = corners_[i] - apex;
      const double volume = dot(a, cross(b, c)) / 6;
      sum.volume += volume;
      sum.first += (a + b + c) * (volume / 4);
    }
  }

 private:
  static constexpr std::size_t kCapacity = 8;
  std::array<Vec3d, kCapacity> corners_;
  std::size_t size_;
};

/// Part of the mesh behind all planes, which must pass through the apex.
Moments moments_behind(const TriangleMesh& mesh, const Pose& X_WT, const Vec3d& apex,
                       std::span<const Plane<double>> planes) {
  Moments sum;
  for_each_triangle(mesh, X_WT, [&](const Triangle& triangle) {
    Polygon polygon(triangle);
    for (const Plane<double>& plane : planes) polygon.clip(plane);
    polygon.add_cone(apex, sum);
  });
  return sum;
}

/// The point of the plane, or of the common line of both planes, nearest to p.
Vec3d foot(const Plane<double>& a, const Vec3d& p) {
  return p - a.normal * (dot(a.normal, p) - a.offset);
}
Vec3d foot(const Plane<double>& a, const Plane<double>& b, const Vec3d& p) {
  const double da = dot(a.normal, p) - a.offset, db = dot(b.normal, p) - b.offset;
  const double c = dot(a.normal, b.normal), s2 = 1 - c * c;
  return p - a.normal * ((da - c * db) / s2) - b.normal * ((db - c * da) / s2);
}

double wedge_volume(const TriangleMesh& tool, const Pose& X_WT, const Plane<double>& a,
                    const Plane<double>& b) {
  const Plane<double> planes[] = {a, b};
  return moments_behind(tool, X_WT, foot(a, b, X_WT.translation), planes).volume;
}

double whole_volume(const TriangleMesh& tool, const Pose& X_WT) {
  return moments_behind(tool, X_WT, X_WT.translation, {}).volume;
}

/// Ball and cone with the apex in the ball's centre. The cone's base is a triangle in a plane at
/// height h, seen from the foot of the apex as three fans, one per edge. A fan's boundary is
/// rho(theta) = d / cos(theta), d being the distance of the edge. Directions that meet the base
/// within the ball contribute volume h rho^2 / 6 per theta, the others (of cone angle w =
/// atan(rho/h)) h c^2 / 6 + r^3 / 3 (cos w_c - cos w), with c the radius of the ball's disc in the
/// base plane.
class BallCone {
 public:
  BallCone(double radius, double height)
      : radius_(radius),
        height_(height),
        disc_(std::sqrt(std::max(0.0, radius * radius - height * height))),
        plateau_(height * disc_ * disc_ / 6 + radius * radius * std::min(radius, height) / 3) {}

  /// Fan over an edge at distance d > 0 between the tangential coordinates t0 < t1.
  double fan(double d, double t0, double t1) const {
    const double half_chord = disc_ > d ? std::sqrt(disc_ * disc_ - d * d) : 0;
    const double in0 = std::clamp(t0, -half_chord, half_chord);
    const double in1 = std::clamp(t1, -half_chord, half_chord);
    return height_ * d * (in1 - in0) / 6 + outside(d, t0, std::min(t1, -half_chord)) +
           outside(d, std::max(t0, half_chord), t1);
  }

 private:
  /// The part of a fan whose base lies beyond the ball.
  double outside(double d, double t0, double t1) const {
    if (!(t0 < t1)) return 0;
    const double angle = std::atan2(t1, d) - std::atan2(t0, d);
    return plateau_ * angle - radius_ * radius_ * radius_ / 3 * (tilt(d, t1) - tilt(d, t0));
  }

  /// Integral of cos w = h / sqrt(h^2 + rho^2) over theta from 0 to atan(t / d).
  double tilt(double d, double t) const {
    const double sine = t / std::sqrt(d * d + t * t);
    return std::asin(height_ * sine / std::sqrt(height_ * height_ + d * d));
  }

  double radius_, height_, disc_;
  double plateau_;
};

double ball_volume(const TriangleMesh& tool, const Pose& X_WT, const Vec3d& centre, double radius) {
  double sum = 0;
  for_each_triangle(tool, X_WT, [&](const Triangle& triangle) {
    const Vec3d normal = normalized(cross(triangle[1] - triangle[0], triangle[2] - triangle[0]));
    const double height = dot(normal, triangle[0] - centre);
    const Vec3d base_foot = centre + normal * height;
    const BallCone cone(radius, std::abs(height));
    double volume = 0;
    for (std::size_t i = 0; i < 3; ++i) {
      const Vec3d &p = triangle[i], &q = triangle[(i + 1) % 3];
      const Vec3d along = normalized(q - p);
      const double d = dot(cross(p - base_foot, along), normal);
      const double t0 = dot(p - base_foot, along), t1 = dot(q - base_foot, along);
      if (d > 0) volume += cone.fan(d, t0, t1);
      if (d < 0) volume -= cone.fan(-d, t0, t1);
    }
    sum += height < 0 ? -volume : volume;
  });
  return sum;
}

}  // namespace

double exact_volume(const TriangleMesh& tool_T, const Pose& X_WT, const Environment& environment) {
  const Plane<double>&a = environment.a, &b = environment.b;
  const auto in_ball = [&] {
    return ball_volume(tool_T, X_WT, environment.centre, environment.radius);
  };
  switch (environment.kind) {
    case Environment::Kind::half_space:
      return moments_behind(tool_T, X_WT, foot(a, X_WT.translation), {&a, 1}).volume;
    case Environment::Kind::ridge: return wedge_volume(tool_T, X_WT, a, b);
    case Environment::Kind::corner:
      return whole_volume(tool_T, X_WT) - wedge_volume(tool_T, X_WT, flipped(a), flipped(b));
    case Environment::Kind::ball_outside: return in_ball();
    case Environment::Kind::ball_inside: return whole_volume(tool_T, X_WT) - in_ball();
  }
  return 0;
}

std::optional<ExactPenetration> exact_penetration(const TriangleMesh& tool_T, const Pose& X_WT,
                                                  const Vec3d& centre_W,
                                                  const Environment& environment) {
  const Plane<double>&a = environment.a, &b = environment.b;
  ExactPenetration result;
  // The part whose nearest surface is one plane pushes along that plane's normal.
  const auto add = [&](const Vec3d& apex, std::span<const Plane<double>> planes) {
    const Moments part = moments_behind(tool_T, X_WT, apex, planes);
    const Vec3d& n = planes[0].normal;
    result.volume += part.volume;
    result.measure_C_W.force += part.volume * n;
    result.measure_C_W.torque += cross(part.first + part.volume * (apex - centre_W), n);
  };
  if (environment.kind == Environment::Kind::half_space) {
    add(foot(a, X_WT.translation), {&a, 1});
    return result;
  }
  if (environment.kind == Environment::Kind::ridge) {
    // Behind the bisector of the two planes, plane a is the nearer one.
    const Vec3d apex = foot(a, b, X_WT.translation);
    const Vec3d across = normalized(b.normal - a.normal);
    const Plane<double> bisector{across, dot(across, apex)};
    const Plane<double> near_a[] = {a, b, bisector}, near_b[] = {b, a, flipped(bisector)};
    add(apex, near_a);
    add(apex, near_b);
    return result;
  }
  return std::nullopt;
}

}  // namespace palpate::scenes
