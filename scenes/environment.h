// Solids known in closed form: the synthetic environments of the thesis (section 5.1.2), and boxes.
#pragma once

#include <array>

#include "palpate/math/geometry.h"

namespace palpate { inline namespace v0 { namespace scenes {

/// A solid. A corner is the complement of a ridge and a ball seen from inside is the complement of
/// one seen from outside; everything here is computed on the convex one of the two.
struct Environment {
  enum class Kind {
    half_space,    ///< behind plane `a`
    ridge,         ///< behind plane `a` and behind plane `b`
    corner,        ///< behind plane `a` or behind plane `b`
    ball_outside,  ///< the ball, seen from its outside
    ball_inside,   ///< everything but the ball, seen from its inside
    box,           ///< around the origin of B, along its axes
  };
  Kind kind = Kind::half_space;
  Plane<double> a, b;  ///< normals point out of the solid; not parallel
  Vec3d center;        ///< of the ball
  double radius = 0;
  Pose X_WB;        ///< of the box
  Vec3d half_size;  ///< of the box, m

  /// All of z >= depth.
  static Environment wall(double depth);
  /// Two walls that meet in the vertical line x = 0, z = depth. The solid fills `opening` radians
  /// around +z: less than pi is a ridge, more a corner.
  static Environment wedge(double depth, double opening);
  /// The point nearest to the camera on the optical axis is at z = depth.
  static Environment ball_outside(double depth, double radius);
  /// The deepest point on the optical axis is at z = depth.
  static Environment ball_inside(double depth, double radius);
  static Environment box(const Pose& X_WB, const Vec3d& half_size);

  /// The same solid in another frame.
  Environment in_frame(const Pose& X_FW) const;

  /// Of a box: -x, +x, -y, +y, -z, +z of B.
  std::array<Plane<double>, 6> faces() const;
};

/// A value of the signed distance field (positive in free space) and its unit gradient, which on
/// the surface is the outward normal. Where several surface points are nearest, one of them counts.
struct SignedDistance {
  double distance = 0;
  Vec3d gradient;
};

/// Euclidean distance to the surface of the solid, exact everywhere.
SignedDistance signed_distance(const Environment& environment, const Vec3d& p);

/// The t > 0 at which the ray t * direction from the origin enters the solid, NaN if it never does.
/// An origin within the solid of `ball_inside` looks through it into the ball.
double first_hit(const Environment& environment, const Vec3d& direction);

}}}  // namespace palpate::v0::scenes
