// A moving rigid body: mass, pose and velocity.
#pragma once

#include "palpate/math/geometry.h"
#include "palpate/mesh/mesh.h"

namespace palpate { inline namespace v0 {

struct RigidBody {
  double mass = 1;  ///< kg
  Mat3d inertia_B;  ///< kg m2, about the center of mass
  Vec3d p_BC;       ///< of the center of mass, m
  Pose X_WB;
  Twist V_W;               ///< of the center of mass, and the angular velocity
  bool is_asleep = false;  ///< it stays where it is, whatever touches it

  Vec3d center_W() const { return X_WB * p_BC; }
};

/// Returns a body at rest, with its mass spread evenly in the solid that `shape` describes. Thin
/// rods and dots also get some inertia about every axis.
RigidBody rigid_body(double mass, const MassProperties& shape, const Vec3d& center_B,
                     const Pose& X_WB);

/// Returns the inertia about the center of mass, in W.
Mat3d inertia_W(const RigidBody& body);

/// Returns the change of velocity by an impulse at the center of mass, in W.
Twist changed_by(const RigidBody& body, const Wrench& impulse);

/// Returns the kinetic energy of translation and rotation, J.
double kinetic_energy(const RigidBody& body);

/// Returns the angular momentum about the center of mass, in W, N m s.
Vec3d angular_momentum(const RigidBody& body);

/// Moves the center of mass by `shift`, and rotates the body for `dt` without torque: angular
/// momentum stays to rounding, and so does the energy (implicit midpoint rule of Euler's equations,
/// with the Cayley map for the rotation).
void move(RigidBody& body, const Vec3d& shift, double dt) noexcept;

}}  // namespace palpate::v0
