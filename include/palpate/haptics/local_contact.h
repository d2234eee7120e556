// The last contact as the haptic loop uses it.
#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <vector>

#include "palpate/contact/contact.h"
#include "palpate/mesh/mesh.h"

namespace palpate { inline namespace v0 {

// Place, width and material of a contact: the input of friction.

/// Material of a surface region.
struct Material {
  double friction = 0;      ///< tangential force over normal force while sliding
  double static_ratio = 1;  ///< static over kinetic friction
  double viscous = 0;       ///< s/m: adds a tangential force of this times N v
  /// Texture amplitudes as shares of the friction: regular waves, and irregular
  /// ones.
  double ridges = 0, grain = 0;

  friend bool operator==(const Material&, const Material&) = default;
};

/// Materials by region of a camera's image: a label per pixel, and the material of some labels.
/// Labels without material use the settings.
struct MaterialRegions {
  int width = 0, height = 0;
  std::vector<std::uint8_t> labels;                ///< row-major, width * height; empty: none
  std::vector<std::optional<Material>> materials;  ///< by label
};

/// Material under a contact, for friction. Shares are of the normal force.
struct Ground {
  double share = 0;  ///< on regions with their own material; for the rest, see ContactPatch
  /// Mean values times their shares: coefficients while sliding and while sticking, ...
  double friction = 0, static_friction = 0;
  double viscous = 0;            ///< s/m
  double ridges = 0, grain = 0;  ///< amplitudes of the texture, as coefficients
  /// Motion of the surface itself under the center of the contact: m/s, and rad/s.
  Vec3d velocity_W, turning_W;

  friend bool operator==(const Ground&, const Ground&) = default;
};

/// The contact patch on which friction acts: where it is, and how wide.
struct ContactPatch {
  Vec3d lever_W;  ///< from the tool's center of mass to the center of the contact, m
  /// Mean distance of the normal force from there, m: the torsional resistance is mu N times
  /// this.
  double torsion_radius = 0;
  /// Share of the normal force with the friction of the settings ...
  double share = 1;
  /// ... and mean coefficient of the rest, on objects with their own friction, times its
  /// share.
  double own_friction = 0;
  Ground ground;
};

/// Patch of a contact with a surface, from the moments of its volume. Exact for parallel normals
/// and, in its torsion radius, for an elliptic patch with even pressure; a rectangle is off by 2 %.
ContactPatch contact_patch(const VolumeWrench& measure_W, double volume, const Stiffness& stiffness,
                           const VolumeMoments& moments);

/// Estimate without moments: the center from the wrench, limited by the reach of this inertia, and
/// a round cap of that volume. `tool` is in T.
ContactPatch guessed_patch(const VolumeWrench& measure_W, double volume, const MassProperties& tool,
                           const Quaternion& q_WT);

/// Combines two contacts of one tool, weighted by their forces `force_a` and `force_b`, N.
ContactPatch joined(const ContactPatch& a, double force_a, const ContactPatch& b, double force_b);

// Linear model of the last contact query around its pose: it lets the haptic loop run at several
// kilohertz, however long a query takes.

/// Contact wrench on the tool at one pose, in N, and its derivative around it.
struct LocalContact {
  double time = 0;  ///< s, monotonic clock: time of the measured device state
  Pose X_WT;
  Vec3d p_WC;                ///< the tool's center of mass, reference point of the wrench
  Wrench F_C_W;              ///< N, N m
  Stiffness stiffness;       ///< N/m, N, N m: see Stiffness, times the gain
  ContactPatch patch;        ///< of the query with the stiffness
  double volume = 0;         ///< m3
  double max_stiffness = 0;  ///< N/m: largest eigenvalue of the force-translation block, 0 or more
  double energy = 0;         ///< J, stored: see stored_energy
  double surface_age = 0;    ///< s, age of the measured depth frame at `time`
  ContactStatus status;
  bool is_valid = false;  ///< false: no measurement yet

  /// The wrench with the tool at another pose nearby, about its center of mass there: F - K (shift,
  /// turn). It never pulls the tool in: if the linear model crosses zero along the measured
  /// direction, the force stays zero.
  Wrench at(const Pose& X_WT_now) const;
};

VolumeStiffness thesis_volume_stiffness(double max_force, double tool_volume);

/// Returns the energy that a contact gives back on the way out, J: its potential, if the method has
/// one; else 0.6 times force times cube root of volume, an upper bound for any compact tool.
double stored_energy(const Penetration& penetration, const VolumeStiffness& scale);

/// Converts a measure and its stiffness (m3 ...) to newtons by `scale`.
LocalContact local_contact(const Penetration& penetration, const Stiffness& stiffness,
                           const Pose& X_WT, const Vec3d& center_of_mass_T,
                           const VolumeStiffness& scale, double time, double surface_age,
                           const ContactPatch& patch = {});

}}  // namespace palpate::v0
