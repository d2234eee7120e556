// What a measurement gives: volume, wrench, stiffness, and what the caller has to know about them.
#pragma once

#include <cstdint>
#include <optional>

#include "palpate/contact/volume_moments.h"
#include "palpate/math/pose.h"

namespace palpate {

/// Things a caller may want to know about a measurement.
enum class StepStatus : std::uint32_t {
  ok = 0,
  non_finite_pose = 1,    ///< the pose was not finite: nothing was measured, all zero
  ambiguous_normals = 2,  ///< a boundary sphere's points disagree (|mean normal| < 0.5)
  /// The GPU did not answer in time or is lost: nothing was measured, all zero. It stays so.
  backend_failed = 4,
  /// There is no surface of the kind that the method asks, a cloud or a field: nothing was measured
  /// against it.
  no_surface = 8,
  no_edge_vectors = 16,  ///< edges are wanted, but the cloud tells none: measured without
  /// Some of the tool may be seen outside of the window that the depth field was made for
  /// (DepthFieldView::asked): nothing was measured against it.
  outside_window = 32,
};

/// Any number of them.
struct ContactStatus {
  std::uint32_t bits = 0;

  constexpr ContactStatus() = default;
  constexpr ContactStatus(StepStatus one) : bits(static_cast<std::uint32_t>(one)) {}

  constexpr bool has(StepStatus one) const { return (bits & static_cast<std::uint32_t>(one)) != 0; }
  /// Whether the result says nothing about the surface.
  constexpr bool is_unmeasured() const {
    return has(StepStatus::non_finite_pose) || has(StepStatus::backend_failed) ||
           has(StepStatus::no_surface) || has(StepStatus::outside_window);
  }
  constexpr ContactStatus& operator|=(ContactStatus other) {
    bits |= other.bits;
    return *this;
  }
  friend constexpr bool operator==(ContactStatus, ContactStatus) = default;
};

/// Newtons per volume times direction. The thesis: the device's largest force at an eighth of the
/// tool's volume.
struct VolumeStiffness {
  double newtons_per_cubic_metre = 0;

  /// N and N m.
  friend constexpr Wrench operator*(VolumeStiffness k, const VolumeWrench& measure) {
    return {measure.force * k.newtons_per_cubic_metre, measure.torque * k.newtons_per_cubic_metre};
  }
};

/// What lies closer behind a seen surface counts as seen, m.
inline constexpr double kSeenBehind = 0.02;

/// The measure for one pose.
struct Penetration {
  double volume = 0;  ///< m3: sum of V_s, kept apart from |force|
  /// force: sum V_s n_s; torque: sum (c_s - C) x V_s n_s about the tool's centre of mass C; both in
  /// W. |force| <= volume for the point methods, 1.05 volume for field.
  VolumeWrench measure_W;
  /// field: U with measure_W = -dU/dpose where no gradient had to be shortened, m4; else 0
  double potential = 0;
  int num_boundary_spheres = 0;  ///< spheres that contain at least one point
  int num_inside_spheres = 0;    ///< untouched spheres with V_s > 0
  int num_points = 0;            ///< points inside some sphere
  ContactStatus status;
  /// Against cameras with SurfaceView::seen_free: the part of the tool that lies more than
  /// kSeenBehind behind all that any camera has seen, or where none looks, m3. Else 0.
  double unseen_volume = 0;
};

/// How the measure changes with the pose: moved by `shift` and turned by the small rotation vector
/// `turn` about C (both in W), (force, torque) becomes (force, torque) - m (shift, turn). Rows and
/// columns: x, y, z of force / shift, then of torque / turn. m2, m3 and m4.
struct Stiffness {
  double m[6][6] = {};

  Stiffness& operator+=(const Stiffness& other) {
    for (int row = 0; row < 6; ++row) {
      for (int column = 0; column < 6; ++column) m[row][column] += other.m[row][column];
    }
    return *this;
  }
};

struct ContactResult {
  Penetration penetration;
  std::optional<Stiffness> stiffness;  ///< if it was wanted and the method has one
  VolumeMoments moments = {};          ///< with the stiffness; else zero
};

}  // namespace palpate
