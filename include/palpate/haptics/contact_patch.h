// Where and how wide a contact is: what friction acts on.
#pragma once

#include "palpate/contact/contact_query.h"
#include "palpate/mesh/mass_properties.h"

namespace palpate {

struct ContactPatch {
  Vec3d lever_W;  ///< from the tool's centre of mass to the middle of the contact, m
  /// How far from there the normal force is on average, m: what slides by turning about the normal
  /// resists with mu N times this.
  double torsion_radius = 0;
  /// Of the normal force: what is felt with the friction of the settings ...
  double share = 1;
  /// ... and mean coefficient of the rest, which is on objects with one of their own, times its
  /// share.
  double own_friction = 0;
};

/// Of a contact with a surface, from the moments of its volume. Exact for parallel normals and, in
/// its torsion radius, for a patch that is an ellipse of even pressure; a rectangle is off by 2 %.
ContactPatch contact_patch(const VolumeWrench& measure_W, double volume, const Stiffness& stiffness,
                           const VolumeMoments& moments);

/// Where no moments are known: the middle from the wrench, as far out as a tool of this inertia
/// reaches, and a round cap of that volume. `tool` is in T.
ContactPatch guessed_patch(const VolumeWrench& measure_W, double volume, const MassProperties& tool,
                           const Quaternion& q_WT);

/// Two contacts of the same tool as one, in shares of their forces `force_a` and `force_b`, N.
ContactPatch joined(const ContactPatch& a, double force_a, const ContactPatch& b, double force_b);

}  // namespace palpate
