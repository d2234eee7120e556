// A rigid body that moves: its mass, where it is and how fast.
#pragma once

#include "palpate/math/geometry.h"
#include "palpate/mesh/mesh.h"

namespace palpate::inline v0 {

struct RigidBody {
  double mass = 1;  ///< kg
  Mat3d inertia_B;  ///< kg m2, about the center of mass
  Vec3d p_BC;       ///< of the center of mass, m
  Pose X_WB;
  Twist V_W;               ///< of the center of mass, and the angular velocity
  bool is_asleep = false;  ///< it stays where it is, whatever touches it

  Vec3d center_W() const { return X_WB * p_BC; }
};

/// At rest, with the mass evenly in the solid that `shape` has the inertia of. What turns has some
/// inertia about every axis, also thin rods and dots.
RigidBody rigid_body(double mass, const MassProperties& shape, const Vec3d& center_B,
                     const Pose& X_WB);

/// About the center of mass, in W.
Mat3d inertia_W(const RigidBody& body);

/// How an impulse at the center of mass, in W, changes the velocity.
Twist changed_by(const RigidBody& body, const Wrench& impulse);

/// J, of moving and turning.
double kinetic_energy(const RigidBody& body);

/// N m s, about the center of mass, in W.
Vec3d angular_momentum(const RigidBody& body);

/// The center of mass moves by `shift`, and the body turns for `dt` with nothing to turn it:
/// angular momentum stays to rounding, and so does the energy (implicit midpoint rule of Euler's
/// equations, with the Cayley map for the rotation).
void move(RigidBody& body, const Vec3d& shift, double dt) noexcept;

}  // namespace palpate::inline v0
