#include "palpate/haptics/local_contact.h"

#include <algorithm>

#include "src/haptics/held_contact.h"
#include "src/math/internal/matrix6.h"
#include "src/math/internal/rotation_vector.h"

namespace palpate { inline namespace v0 {
namespace {

/// Largest ratio of force and torque to the measured ones: a line through one measurement says
/// little about a force of several times that size.
constexpr double kMaxGrowth = 4;

/// Returns v, shortened to `limit`.
Vec3d shortened(const Vec3d& v, double limit) {
  const double length = norm(v);
  return length > limit ? v * (limit / length) : v;
}

double trace(const Stiffness& k, int first) {
  return k.m[first][first] + k.m[first + 1][first + 1] + k.m[first + 2][first + 2];
}

/// Returns the radius of gyration of the contact's stiffness about the center of mass.
double lever(const Stiffness& k) {
  const double forces = trace(k, 0), torques = trace(k, 3);
  return forces > 0 && torques > 0 ? std::sqrt(torques / forces) : 0;
}

/// Largest eigenvalue of the symmetric part of the upper left block (trigonometric solution of the
/// characteristic equation).
double largest_eigenvalue(const Stiffness& k) {
  const auto a = [&k](int i, int j) { return (k.m[i][j] + k.m[j][i]) / 2; };
  const double mean = trace(k, 0) / 3;
  const double off = a(0, 1) * a(0, 1) + a(0, 2) * a(0, 2) + a(1, 2) * a(1, 2);
  const double d[3] = {a(0, 0) - mean, a(1, 1) - mean, a(2, 2) - mean};
  const double p = std::sqrt((d[0] * d[0] + d[1] * d[1] + d[2] * d[2] + 2 * off) / 6);
  if (!(p > 0)) return mean;
  const double determinant = d[0] * (d[1] * d[2] - a(1, 2) * a(1, 2)) -
                             a(0, 1) * (a(0, 1) * d[2] - a(1, 2) * a(0, 2)) +
                             a(0, 2) * (a(0, 1) * a(1, 2) - d[1] * a(0, 2));
  const double half = std::clamp(determinant / (p * p * p) / 2, -1.0, 1.0);
  return mean + 2 * p * std::cos(std::acos(half) / 3);
}

}  // namespace

Vec6 motion_since(const LocalContact& contact, const Pose& X_WT_now) {
  const Vec3d c_T = inverse(contact.X_WT) * contact.p_WC;
  return {X_WT_now * c_T - contact.p_WC,
          rotation_between(contact.X_WT.rotation, X_WT_now.rotation)};
}

Wrench contact_line(const LocalContact& contact, const Pose& X_WT_now) {
  const Vec6 motion = motion_since(contact, X_WT_now);
  Mat6 k;
  std::copy(&contact.stiffness.m[0][0], &contact.stiffness.m[0][0] + 36, &k.m[0][0]);
  return to_wrench(to_vec6(contact.F_C_W) - k * motion);
}

// The share of the force that remains along its measured direction bounds force and torque. As it
// falls to zero, so do sideways force and torque: the wrench ends without a jump.
Wrench limit_contact(const LocalContact& contact, const Wrench& line) {
  const double force = norm(contact.F_C_W.force);
  const double remaining = force > 0 ? dot(line.force, contact.F_C_W.force / force) / force : 1;
  if (!(remaining > 0) || !is_finite(line)) return {};
  const double growth = kMaxGrowth * std::min(remaining, 1.0);
  const double torque = std::max(norm(contact.F_C_W.torque), force * lever(contact.stiffness));
  return {shortened(line.force, growth * force), shortened(line.torque, growth * torque)};
}

Wrench LocalContact::at(const Pose& X_WT_now) const {
  if (!is_valid || !is_finite(X_WT_now)) return {};
  return limit_contact(*this, contact_line(*this, X_WT_now));
}

VolumeStiffness thesis_volume_stiffness(double max_force, double tool_volume) {
  const double scale = max_force / (tool_volume / 8);
  return {scale > 0 && std::isfinite(scale) ? scale : 0};
}

/// Without a potential, estimates the energy as a share of force times cube root of volume: with an
/// eighth inside, 0.20 for a ball, 0.13 for a cube and 0.58 for a rod ten times as long as thick,
/// end first; less for less inside.
double stored_energy(const Penetration& penetration, const VolumeStiffness& scale) {
  constexpr double kMaxShare = 0.6;
  const double measure =
      penetration.potential > 0 || !(penetration.volume > 0)
          ? penetration.potential
          : kMaxShare * norm(penetration.measure_W.force) * std::cbrt(penetration.volume);
  return scale.newtons_per_cubic_meter * measure;
}

LocalContact local_contact(const Penetration& penetration, const Stiffness& stiffness,
                           const Pose& X_WT, const Vec3d& center_of_mass_T,
                           const VolumeStiffness& scale, double time, double surface_age,
                           const ContactPatch& patch) {
  LocalContact contact;
  contact.patch = patch;
  contact.time = time;
  contact.X_WT = X_WT;
  contact.p_WC = X_WT * center_of_mass_T;
  contact.surface_age = surface_age;
  contact.status = penetration.status;
  contact.volume = penetration.volume;
  const double gain = scale.newtons_per_cubic_meter;
  contact.F_C_W = scale * penetration.measure_W;
  contact.energy = stored_energy(penetration, scale);
  bool finite = is_finite(X_WT) && is_finite(contact.F_C_W) && is_finite(patch.lever_W) &&
                std::isfinite(patch.torsion_radius);
  for (int i = 0; i < 6; ++i) {
    for (int j = 0; j < 6; ++j) {
      contact.stiffness.m[i][j] = gain * stiffness.m[i][j];
      finite = finite && std::isfinite(contact.stiffness.m[i][j]);
    }
  }
  contact.is_valid = finite && !penetration.status.is_unmeasured();
  if (contact.is_valid)
    contact.max_stiffness = std::max(0.0, largest_eigenvalue(contact.stiffness));
  return contact;
}

}}  // namespace palpate::v0
