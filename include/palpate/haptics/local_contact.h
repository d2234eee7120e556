// What the last contact query said, as far as it holds around its pose: lets the hand be served at
// several kilohertz, however long a query takes.
#pragma once

#include "palpate/contact/contact_query.h"
#include "palpate/haptics/contact_patch.h"

namespace palpate {

/// Contact wrench on the tool at one pose, in newtons, and how it changes around it.
struct LocalContact {
  double time = 0;  ///< s, monotonic clock: of the device state that was measured
  Pose X_WT;
  Vec3d p_WC;                ///< the tool's centre of mass: the wrench is about it
  Wrench F_C_W;              ///< N, N m
  Stiffness stiffness;       ///< N/m, N, N m: see Stiffness, times the gain
  ContactPatch patch;        ///< of the query that the stiffness is of
  double volume = 0;         ///< m3
  double max_stiffness = 0;  ///< N/m: largest eigenvalue of the force-translation block, 0 or more
  double surface_age = 0;    ///< s, of the depth frame that was measured, at `time`
  ContactStatus status;
  bool is_valid = false;  ///< false: nothing has been measured yet

  /// The wrench with the tool at another pose near by, about its own centre of mass there:
  /// F - K (shift, turn). It never pulls the tool in: where the line crosses zero along the
  /// measured direction, it stays zero.
  Wrench at(const Pose& X_WT_now) const;
};

VolumeStiffness thesis_volume_stiffness(double max_force, double tool_volume);

/// `measure_W` and `stiffness` in m3 ... as a contact of that scale.
LocalContact local_contact(const Penetration& penetration, const Stiffness& stiffness,
                           const Pose& X_WT, const Vec3d& centre_of_mass_T,
                           const VolumeStiffness& scale, double time, double surface_age,
                           const ContactPatch& patch = {});

}  // namespace palpate
