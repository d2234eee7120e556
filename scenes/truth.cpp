// Everything here rests on one idea. Seen from an apex, a closed mesh is a signed sum of cones, one
// over each triangle. If every surface of the environment looks edge-on from the apex (planes
// through it) or is a sphere around it, cutting the cones cuts the solid and no cap has to be
// constructed.
#include "scenes/truth.h"

#include <span>

#include "scenes/mesh_faces.h"

namespace palpate { inline namespace v0 { namespace scenes {
namespace {

/// Six planes at most.
double volume_behind(const TriangleMesh& mesh, const Pose& X_WT, const Vec3d& apex,
                     std::span<const Plane<double>> planes) {
  double sum = 0;
  for_each_face(mesh, X_WT, [&](const Triangle& face) {
    Polygon polygon(face);
    for (const Plane<double>& plane : planes) polygon.clip(plane);
    polygon.for_each_triangle(
        [&](const Triangle& t) { sum += dot(t[0] - apex, cross(t[1] - apex, t[2] - apex)) / 6; });
  });
  return sum;
}

double wedge_volume(const TriangleMesh& tool, const Pose& X_WT, const Plane<double>& a,
                    const Plane<double>& b) {
  const Plane<double> planes[] = {a, b};
  return volume_behind(tool, X_WT, foot(a, b, X_WT.translation), planes);
}

double whole_volume(const TriangleMesh& tool, const Pose& X_WT) {
  return volume_behind(tool, X_WT, X_WT.translation, {});
}

/// All but what is beyond a face; what is beyond two or three of them was taken away twice or
/// thrice. Beyond both faces of an axis is nothing.
double box_volume(const TriangleMesh& tool, const Pose& X_WT, const Environment& box) {
  const auto faces = box.faces();
  double sum = 0;
  for (int choice = 0; choice < 27; ++choice) {
    std::array<Plane<double>, 3> beyond;
    std::size_t num = 0;
    Vec3d apex = X_WT.translation;
    for (int axis = 0, rest = choice; axis < 3; ++axis, rest /= 3) {
      if (rest % 3 == 0) continue;
      const auto& face = faces[static_cast<std::size_t>(2 * axis + rest % 3 - 1)];
      beyond[num++] = flipped(face);
      apex = foot(face, apex);  // the axes are at right angles: it stays on the others
    }
    sum += (num % 2 == 0 ? 1 : -1) * volume_behind(tool, X_WT, apex, {beyond.data(), num});
  }
  return sum;
}

/// Ball and cone with the apex in the ball's center. The cone's base is a triangle in a plane at
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

double ball_volume(const TriangleMesh& tool, const Pose& X_WT, const Vec3d& center, double radius) {
  double sum = 0;
  for_each_face(tool, X_WT, [&](const Triangle& face) {
    const Vec3d normal = normalized(doubled_area(face));
    const double height = dot(normal, face[0] - center);
    const BallCone cone(radius, std::abs(height));
    const double volume =
        sum_of_fans(face, normal, center + normal * height,
                    [&](double d, double t0, double t1) { return cone.fan(d, t0, t1); });
    sum += height < 0 ? -volume : volume;
  });
  return sum;
}

}  // namespace

double exact_volume(const TriangleMesh& tool_T, const Pose& X_WT, const Vec3d& apex,
                    std::span<const Plane<double>> planes) {
  return volume_behind(tool_T, X_WT, apex, planes);
}

double exact_volume(const TriangleMesh& tool_T, const Pose& X_WT, const Environment& environment) {
  const Plane<double>&a = environment.a, &b = environment.b;
  const auto in_ball = [&] {
    return ball_volume(tool_T, X_WT, environment.center, environment.radius);
  };
  switch (environment.kind) {
    case Environment::Kind::half_space:
      return volume_behind(tool_T, X_WT, foot(a, X_WT.translation), {&a, 1});
    case Environment::Kind::ridge: return wedge_volume(tool_T, X_WT, a, b);
    case Environment::Kind::corner:
      return whole_volume(tool_T, X_WT) - wedge_volume(tool_T, X_WT, flipped(a), flipped(b));
    case Environment::Kind::ball_outside: return in_ball();
    case Environment::Kind::ball_inside: return whole_volume(tool_T, X_WT) - in_ball();
    case Environment::Kind::box: return box_volume(tool_T, X_WT, environment);
  }
  return 0;
}

}}}  // namespace palpate::v0::scenes
