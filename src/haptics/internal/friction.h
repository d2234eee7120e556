// Coulomb friction of a contact patch that truly sticks: a spring (the bristle) that gives way when
// its force leaves a limit surface, solved implicitly in each tick (after Kikuuwe et al. 2006).
//
// Sliding has three coordinates: two along the surface and the rotation about its normal times the
// torsion radius. In these the limit surface of the patch is a ball of radius mu N (an ellipsoid of
// force and torque), and the bristle is equally stiff in all directions. Decision 27 says why this
// loses energy whatever the tool and the surface do.
#pragma once

#include "palpate/haptics/coupling.h"
#include "src/haptics/internal/matrix6.h"

namespace palpate { inline namespace v0 {

/// Symmetric matrix over the three sliding coordinates.
struct Mat3s {
  double xx = 0, xy = 0, xz = 0, yy = 0, yz = 0, zz = 0;
};

/// Returns the stiffness of the bristle, N/m, for a coupling whose options are checked.
double friction_stiffness(const CouplingOptions& options, const DeviceLimits& limits);

/// The contact patch of the tool at a tick.
struct TouchedPatch {
  double normal_force = 0;  ///< N
  double limit = 0;         ///< N: Coulomb friction
  double slope = 0;         ///< N s/m: viscous friction
  /// Rows of the Jacobian of the sliding coordinates by the tool's motion about its center of mass;
  /// a force in these directions acts on the tool by the transpose.
  Vec6 slides[3];
  Vec6 approach;  ///< the same along the normal, away from the surface
  Vec3d carried;  ///< motion of the surface itself within the tick

  Vec3d slid_by(const Vec6& motion) const;
  Vec6 wrench(const Vec3d& force) const;
  /// Returns the sliding per force in the three directions where a wrench moves the tool by
  /// a^-1 wrench, with the factor of a; `motions` gets those of the tool.
  Mat3s compliance(const Factor6& factor, Vec6 (&motions)[3]) const;
};

class PatchFriction {
 public:
  /// `stiffness` of the bristle, N/m, applies if the options set none; `damping_time` is its
  /// damping over its stiffness, s.
  PatchFriction(const CouplingOptions& options, double stiffness, double damping_time);

  /// True if a contact has friction or damping at all.
  bool is_on(const LocalContact& contact) const;
  void reset() noexcept { state_ = {}; }
  /// Sets the stiffness, N/m, and damping over stiffness, s, of the bristle.
  void use(double stiffness, double damping_time) noexcept {
    stiffness_ = stiffness;
    damping_time_ = damping_time;
  }
  void take_over(const FrictionState& state) noexcept { state_ = state; }
  const FrictionState& state() const noexcept { return state_; }

  /// Computes the patch at a tick of length dt from the wrench that pushes the tool there. False:
  /// nothing is touched, and the bristle is released.
  bool touch(const LocalContact& contact, const Wrench& contact_W, double dt,
             TouchedPatch& patch) noexcept;

  /// Friction of a tick: the force on the tool in the three directions when it slides by `slid` +
  /// `compliance` times that force, m and m/N, over a surface that stands still or is `carried`
  /// meanwhile. `dt` is 0 where time does not matter.
  /// `hold` computes it, `keep` makes it the state that the next tick begins with.
  struct Grip {
    Vec3d force;    // N
    Vec3d slid;     // m, all in all
    Vec3d bristle;  // m, afterwards
    bool is_sliding = false;
  };
  Grip hold(const TouchedPatch& patch, const Vec3d& slid, const Mat3s& compliance,
            double dt) const noexcept;
  void keep(const TouchedPatch& patch, const Grip& grip, double dt) noexcept;

  /// Returns the energy stored in the bristle, J.
  double energy() const noexcept {
    const double turn = state_.bristle_rotation;
    return stiffness_ / 2 * (dot(state_.bristle_W, state_.bristle_W) + turn * turn);
  }

  /// Damping along the normal, N s/m, of a contact with this force that moves apart at `speed`
  /// (negative: approaches): such that it never pulls.
  double contact_damping(double normal_force, double speed) const noexcept;

 private:
  double wave(TextureKind kind, double depth, double dt) const noexcept;

  FrictionOptions options_;
  TextureOptions texture_;
  double stiffness_, damping_time_;
  FrictionState state_;
};

}}  // namespace palpate::v0
