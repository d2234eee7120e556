// The wrench is that of a hydrostatic pressure. The distance phi vanishes on the surface of the
// environment, so by Gauss' theorem the integrals over the common part become integrals over the
// submerged faces of the tool, nu being the faces' outward normal:
//   integral of n          =  integral of phi nu             (n = grad phi)
//   integral of (x-C) x n  =  integral of phi (x-C) x nu
// What is left is phi over polygons on which it is linear, or the distance from a line, or over
// triangles and balls around one point.
#include <array>
#include <initializer_list>
#include <span>

#include "scenes/mesh_faces.h"
#include "scenes/truth.h"

namespace palpate { inline namespace v0 { namespace scenes {
namespace {

/// Means over a triangle of phi and of phi (x - C).
struct PressureMeans {
  double pressure = 0;
  Vec3d moment;
};

PressureMeans operator+(const PressureMeans& a, const PressureMeans& b) {
  return {a.pressure + b.pressure, a.moment + b.moment};
}

PressureMeans operator*(const PressureMeans& a, double s) { return {a.pressure * s, a.moment * s}; }

/// phi = height over a plane: exact.
PressureMeans means_of(const Plane<double>& plane, const Triangle& t, const Vec3d& center) {
  const double pa = height_over(plane, t[0]), pb = height_over(plane, t[1]),
               pc = height_over(plane, t[2]);
  const Vec3d a = t[0] - center, b = t[1] - center, c = t[2] - center;
  const Vec3d products = a * pa + b * pb + c * pc;
  return {(pa + pb + pc) / 3, ((a + b + c) * (pa + pb + pc) + products) / 12};
}

/// phi = minus the distance from a line: by quadrature.
struct Line {
  Vec3d point, direction;
  double phi(const Vec3d& p) const { return -norm(cross(p - point, direction)); }
};

/// Seven points, exact for polynomials of degree 5 (Radon 1948).
PressureMeans radon_means(const Line& line, const Triangle& t, const Vec3d& center) {
  const double root = std::sqrt(15.0);
  const Vec3d middle = (t[0] + t[1] + t[2]) / 3;
  PressureMeans sum;
  const auto add = [&](const Vec3d& p, double weight) {
    const double phi = line.phi(p) * weight;
    sum = sum + PressureMeans{phi, (p - center) * phi};
  };
  add(middle, 9.0 / 40);
  for (const Vec3d& corner : t) {
    add(middle + (corner - middle) * ((1 + root) / 7), (155 - root) / 1200);
    add(middle + (corner - middle) * ((1 - root) / 7), (155 + root) / 1200);
  }
  return sum;
}

/// Halves the edges until that changes nothing: the distance is smooth away from the line and bends
/// on it, so only triangles that touch the line are halved often. `tolerance` is that of the mean
/// over this triangle.
PressureMeans adaptive_means(const Line& line, const Triangle& t, const Vec3d& center,
                             const PressureMeans& coarse, double tolerance) {
  const Vec3d ab = (t[0] + t[1]) / 2, bc = (t[1] + t[2]) / 2, ca = (t[2] + t[0]) / 2;
  const std::array<Triangle, 4> parts{
      {{t[0], ab, ca}, {ab, t[1], bc}, {ca, bc, t[2]}, {ab, bc, ca}}};
  std::array<PressureMeans, 4> means;
  PressureMeans fine;
  for (std::size_t i = 0; i < parts.size(); ++i) {
    means[i] = radon_means(line, parts[i], center);
    fine = fine + means[i] * 0.25;
  }
  const double reach = norm(t[0] - center) + norm(t[1] - t[0]) + norm(t[2] - t[0]);
  if (std::abs(fine.pressure - coarse.pressure) <= tolerance &&
      norm(fine.moment - coarse.moment) <= tolerance * reach)
    return fine;
  fine = {};
  for (std::size_t i = 0; i < parts.size(); ++i) {
    fine = fine + adaptive_means(line, parts[i], center, means[i], 4 * tolerance) * 0.25;
  }
  return fine;
}

/// Of the longest distance; the finer sum is better than the difference that it stops at.
constexpr double kTolerance = 1e-10;

PressureMeans means_of(const Line& line, const Triangle& t, const Vec3d& center) {
  const double deepest = -std::min({line.phi(t[0]), line.phi(t[1]), line.phi(t[2])});
  return adaptive_means(line, t, center, radon_means(line, t, center), kTolerance * deepest);
}

/// One side of a plane. Regions that share a plane lie on different sides of it, so that a face of
/// the tool within the plane belongs to one of them.
struct Side {
  Plane<double> plane;
  bool in_front;
};

Side behind(const Plane<double>& plane) { return {plane, false}; }
Side in_front(const Plane<double>& plane) { return {plane, true}; }

/// Adds the pressure on the part of the tool on the given sides.
template <class Field>
void add_pressure(const TriangleMesh& tool, const Pose& X_WT, std::span<const Side> sides,
                  const Field& field, const Vec3d& center, VolumeWrench& sum) {
  for_each_face(tool, X_WT, [&](const Triangle& face) {
    Polygon polygon(face);
    for (const Side& side : sides) {
      side.in_front ? polygon.clip_in_front(side.plane) : polygon.clip(side.plane);
    }
    polygon.for_each_triangle([&](const Triangle& t) {
      const Vec3d area = doubled_area(t) / 2;
      if (area == Vec3d{}) return;
      const PressureMeans means = means_of(field, t, center);
      sum.force += area * means.pressure;
      sum.torque += cross(means.moment, area);
    });
  });
}

template <class Field>
void add_pressure(const TriangleMesh& tool, const Pose& X_WT, std::initializer_list<Side> sides,
                  const Field& field, const Vec3d& center, VolumeWrench& sum) {
  add_pressure(tool, X_WT, std::span<const Side>(sides.begin(), sides.size()), field, center, sum);
}

/// A plane through the common line of a and b: behind it, h_a <= factor * h_b.
Plane<double> through_edge(const Plane<double>& a, const Plane<double>& b, double factor) {
  return {a.normal - b.normal * factor, a.offset - b.offset * factor};
}

/// Within a ridge the nearer plane counts.
VolumeWrench ridge_wrench(const TriangleMesh& tool, const Pose& X_WT, const Environment& e,
                          const Vec3d& center) {
  const Plane<double> halfway = through_edge(e.a, e.b, 1);
  VolumeWrench sum;
  add_pressure(tool, X_WT, {behind(e.a), behind(e.b), in_front(halfway)}, e.a, center, sum);
  add_pressure(tool, X_WT, {behind(e.a), behind(e.b), behind(halfway)}, e.b, center, sum);
  return sum;
}

/// Within a box the nearest face counts: it is cut into six parts.
VolumeWrench box_wrench(const TriangleMesh& tool, const Pose& X_WT, const Environment& e,
                        const Vec3d& center) {
  const auto faces = e.faces();
  VolumeWrench sum;
  for (std::size_t i = 0; i < faces.size(); ++i) {
    std::array<Side, 6> sides{behind(faces[i])};
    std::size_t num = 1;
    for (std::size_t j = 0; j < faces.size(); ++j) {
      if (j == i) continue;
      sides[num++] = i < j ? in_front(through_edge(faces[i], faces[j], 1))
                           : behind(through_edge(faces[j], faces[i], 1));
    }
    add_pressure(tool, X_WT, std::span<const Side>(sides), faces[i], center, sum);
  }
  return sum;
}

/// Behind a corner the nearest point of free space is the foot of the perpendicular on either plane
/// where it exists, and else on the edge (compare wedge_distance in environment.cpp).
VolumeWrench corner_wrench(const TriangleMesh& tool, const Pose& X_WT, const Environment& e,
                           const Vec3d& center) {
  const double c = dot(e.a.normal, e.b.normal);
  const Plane<double> off_b = through_edge(e.a, e.b, c), off_a = through_edge(e.b, e.a, c);
  const Line edge{foot(e.a, e.b, center), normalized(cross(e.a.normal, e.b.normal))};
  VolumeWrench sum;
  add_pressure(tool, X_WT, {behind(e.a), in_front(off_a)}, e.a, center, sum);
  add_pressure(tool, X_WT, {behind(e.b), in_front(off_b)}, e.b, center, sum);
  add_pressure(tool, X_WT, {behind(off_a), behind(off_b)}, edge, center, sum);
  return sum;
}

/// Integrals of |x - o| - R over fans in a plane at distance h of the center o of a ball of radius
/// R, seen from the foot of o (mesh_faces.h).
class BallPressure {
 public:
  BallPressure(double radius, double height)
      : radius_(radius),
        height_(height),
        disc_(std::sqrt(std::max(0.0, radius * radius - height * height))),
        sector_(height < radius ? distances(disc_ * disc_) - radius * disc_ * disc_ / 2 : 0) {}

  /// Over the whole fan.
  double whole(double d, double t0, double t1) const {
    return distance_up_to(d, t1) - distance_up_to(d, t0) - radius_ * d * (t1 - t0) / 2;
  }

  /// Over its part within the ball: up to the edge where that is within, else a sector of the disc.
  double in_ball(double d, double t0, double t1) const {
    const double half_chord = disc_ > d ? std::sqrt(disc_ * disc_ - d * d) : 0;
    const double in0 = std::clamp(t0, -half_chord, half_chord);
    const double in1 = std::clamp(t1, -half_chord, half_chord);
    const auto angle = [&](double from, double to) {
      return from < to ? std::atan2(to, d) - std::atan2(from, d) : 0;
    };
    return whole(d, in0, in1) +
           sector_ * (angle(t0, std::min(t1, -half_chord)) + angle(std::max(t0, half_chord), t1));
  }

 private:
  /// Integral of sqrt(h^2 + s^2) s ds from 0 to rho.
  double distances(double rho2) const {
    return (std::pow(height_ * height_ + rho2, 1.5) - std::pow(height_, 3)) / 3;
  }

  /// Integral of the distance |x - o| over the fan from 0 to t: of distances(d^2 / cos^2(theta))
  /// over theta.
  double distance_up_to(double d, double t) const {
    const double h2 = height_ * height_, q2 = h2 + d * d, w = std::sqrt(q2 + t * t);
    const double log = std::asinh(t / std::sqrt(q2));
    const double turned = std::atan2(height_ * t, d * w) - std::atan2(t, d);
    return (d * (t * w + (q2 + 2 * h2) * log) / 2 + h2 * height_ * turned) / 3;
  }

  double radius_, height_;
  double disc_;    ///< radius of the ball's disc in the plane
  double sector_;  ///< integral over the disc, per radian
};

/// Every n points along a line through the ball's center, so there the torque is zero.
VolumeWrench ball_wrench(const TriangleMesh& tool, const Pose& X_WT, const Environment& e,
                         const Vec3d& center) {
  const bool outside = e.kind == Environment::Kind::ball_outside;
  Vec3d force;
  for_each_face(tool, X_WT, [&](const Triangle& face) {
    const Vec3d normal = normalized(doubled_area(face));
    const double height = dot(normal, face[0] - e.center);
    const BallPressure pressure(e.radius, std::abs(height));
    force += normal * sum_of_fans(face, normal, e.center + normal * height,
                                  [&](double d, double t0, double t1) {
                                    const double in_ball = pressure.in_ball(d, t0, t1);
                                    return outside ? in_ball : in_ball - pressure.whole(d, t0, t1);
                                  });
  });
  return {force, cross(e.center - center, force)};
}

VolumeWrench exact_wrench(const TriangleMesh& tool, const Pose& X_WT, const Environment& e,
                          const Vec3d& center) {
  switch (e.kind) {
    case Environment::Kind::half_space: {
      VolumeWrench sum;
      add_pressure(tool, X_WT, {behind(e.a)}, e.a, center, sum);
      return sum;
    }
    case Environment::Kind::ridge: return ridge_wrench(tool, X_WT, e, center);
    case Environment::Kind::corner: return corner_wrench(tool, X_WT, e, center);
    case Environment::Kind::ball_outside:
    case Environment::Kind::ball_inside: return ball_wrench(tool, X_WT, e, center);
    case Environment::Kind::box: return box_wrench(tool, X_WT, e, center);
  }
  return {};
}

}  // namespace

ExactPenetration exact_penetration(const TriangleMesh& tool_T, const Pose& X_WT,
                                   const Vec3d& center_W, const Environment& environment) {
  return {exact_volume(tool_T, X_WT, environment),
          exact_wrench(tool_T, X_WT, environment, center_W)};
}

}}}  // namespace palpate::v0::scenes
