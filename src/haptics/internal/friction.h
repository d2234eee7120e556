// Coulomb friction of a contact patch that truly sticks: a spring that gives way when what it holds
// leaves a limit surface, solved implicitly in each tick (after Kikuuwe et al. 2006).
//
// What slides has three numbers: two along the surface and the turn about its normal times the
// torsion radius. In these the limit surface of the patch is a ball of radius mu N (an ellipsoid of
// force and torque), and the spring that sticks is the same in all directions. Decision 27 says why
// this loses energy whatever the tool and the surface do.
#pragma once

#include "palpate/haptics/coupling.h"
#include "src/haptics/internal/matrix6.h"

namespace palpate::inline v0 {

/// Symmetric, of the three numbers.
struct Mat3s {
  double xx = 0, xy = 0, xz = 0, yy = 0, yz = 0, zz = 0;
};

/// Of what sticks to a surface, N/m, with a coupling whose options are checked.
double friction_stiffness(const CouplingOptions& options, const DeviceLimits& limits);

/// Where and how the tool touches at a tick.
struct TouchedPatch {
  double normal_force = 0;  ///< N
  double limit = 0;         ///< N: what may slide resists with this
  double slope = 0;         ///< N s/m: and with this times its speed
  /// What a motion of the tool about its centre of mass slides is their products; a force in their
  /// directions is their sum on the tool.
  Vec6 slides[3];
  Vec6 approach;  ///< the same along the normal, away from the surface
  Vec3d carried;  ///< what the surface slides by itself in the tick

  Vec3d slid_by(const Vec6& motion) const;
  Vec6 wrench(const Vec3d& force) const;
  /// What forces in the three directions slide where a wrench moves the tool by a^-1 wrench, with
  /// the factor of a; and these motions.
  Mat3s compliance(const Factor6& factor, Vec6 (&motions)[3]) const;
};

class PatchFriction {
 public:
  /// Of what sticks: its stiffness, N/m, if the options do not say, and its damping over its
  /// stiffness, s.
  PatchFriction(const CouplingOptions& options, double stiffness, double damping_time);

  /// Whether a contact has friction or damping at all.
  bool is_on(const LocalContact& contact) const;
  void reset() noexcept { state_ = {}; }
  /// Of what sticks from now on, as of the constructor.
  void use(double stiffness, double damping_time) noexcept {
    stiffness_ = stiffness;
    damping_time_ = damping_time;
  }
  void take_over(const FrictionState& state) noexcept { state_ = state; }
  const FrictionState& state() const noexcept { return state_; }
  void remember(StateNumbers& numbers) noexcept {
    numbers(state_.bristle_W, state_.bristle_rotation, state_.normal_W, state_.distance,
            state_.speed, state_.is_sliding);
  }

  /// The patch at a tick of length dt, by the wrench that pushes the tool there. False: nothing is
  /// touched, and what stuck has come loose.
  bool touch(const LocalContact& contact, const Wrench& contact_W, double dt,
             TouchedPatch& patch) noexcept;

  /// What friction does in a tick: the force on the tool in the three directions when it slides by
  /// `slid` + `compliance` times that force, m and m/N, over a surface that stands still or is
  /// `carried` meanwhile. `dt` is 0 where time does not matter. Then
  /// `keep` makes it the state that the next tick begins with.
  struct Grip {
    Vec3d force;    // N
    Vec3d slid;     // m, all in all
    Vec3d bristle;  // m, afterwards
    bool is_sliding = false;
  };
  Grip hold(const TouchedPatch& patch, const Vec3d& slid, const Mat3s& compliance,
            double dt) const noexcept;
  void keep(const TouchedPatch& patch, const Grip& grip, double dt) noexcept;

  /// What is stored in what sticks, J.
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

}  // namespace palpate::inline v0
