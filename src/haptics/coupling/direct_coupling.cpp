// Couplings with the tool at the hand, which feels the contact itself (a penalty method, as stiff
// as the contact) or nothing.
#include <tuple>

#include "src/haptics/approach.h"
#include "src/haptics/coupling/couplings.h"
#include "src/haptics/coupling/rotated.h"
#include "src/haptics/internal/friction.h"

namespace palpate { inline namespace v0 {
namespace {

/// Damping over stiffness of sticking friction, s. A spring held over a tick gives back more than
/// it took, see check_coupling: this damping takes it while ticks are no longer than this.
constexpr double kDampingTime = 1e-3;

/// Friction of a tool whose motion is given.
class MovedFriction {
 public:
  MovedFriction(const CouplingOptions& options, const DeviceLimits& limits, double share,
                const MassProperties& tool)
      : friction_(options, share * options.stiffness / options.motion_scale, kDampingTime),
        max_damping_(limits.max_damping > 0 ? limits.max_damping / options.motion_scale
                                            : std::numeric_limits<double>::infinity()),
        c_T_(tool.center_of_mass) {}

  void reset(const Pose& X_WT) noexcept {
    friction_.reset();
    X_WT_ = X_WT;
  }
  void take_over(const CouplingState& state) noexcept {
    friction_.take_over(state.friction);
    X_WT_ = state.X_WT;
  }
  const FrictionState& state() const noexcept { return friction_.state(); }
  double energy() const noexcept { return friction_.energy(); }

  /// Returns the friction and damping of a contact with this wrench. Call once per tick.
  Wrench step(const LocalContact& contact, const Wrench& contact_W, const Pose& X_WT,
              double dt) noexcept {
    const Vec6 motion{X_WT * c_T_ - X_WT_ * c_T_, rotation_between(X_WT_.rotation, X_WT.rotation)};
    X_WT_ = X_WT;
    TouchedPatch patch;
    if (!friction_.is_on(contact) || !friction_.touch(contact, contact_W, dt, patch)) return {};
    Vec6 wrench;
    if (dt > 0) {
      const Vec3d& n = patch.approach.linear;
      const double speed =
          (dot(n, motion.linear) + dot(patch.approach.angular, motion.angular)) / dt;
      const double damping =
          std::min(friction_.contact_damping(patch.normal_force, speed), max_damping_);
      wrench = -damping * speed * patch.approach;
      const double share = 1 - damping * speed / patch.normal_force;
      patch.limit *= share;
      patch.slope *= share;
    }
    const PatchFriction::Grip grip = friction_.hold(patch, patch.slid_by(motion), {}, dt);
    friction_.keep(patch, grip, dt);
    return to_wrench(wrench + patch.wrench(grip.force));
  }

 private:
  PatchFriction friction_;
  double max_damping_;  // N s/m
  Vec3d c_T_;
  Pose X_WT_;  // at the last tick
};

Wrench operator+(const Wrench& a, const Wrench& b) {
  return {a.force + b.force, a.torque + b.torque};
}

class DirectCoupling final : public Coupling {
 public:
  DirectCoupling(const CouplingOptions& options, const DeviceLimits& limits,
                 const MassProperties& tool)
      : scale_(options.motion_scale),
        hand_(options, tool.center_of_mass),
        contact_(options.hold, radius_of_gyration(tool)),
        friction_(options, limits, 1, tool),
        approach_(tool.center_of_mass) {}

  void reset(const DeviceState& state) noexcept override {
    X_WT_ = hand_.follow(state).X_WT;
    contact_.reset();
    friction_.reset(X_WT_);
  }
  void take_over(const CouplingState& state) noexcept override {
    hand_.take_over(state);
    contact_.reset();
    X_WT_ = state.X_WT;
    friction_.take_over(state);
    approach_.begin(X_WT_);
  }
  CouplingState state() const noexcept override {
    const HeldTool& held = hand_.held();
    return {hand_.X_BH(),
            held.X_WT,
            X_WT_,
            {held.velocity.linear, held.velocity.angular},
            friction_.state()};
  }
  Pose held_pose(const DeviceState& state) const noexcept override { return hand_.held_by(state); }

  CouplingStep step(const DeviceState& state, const LocalContact& contact,
                    double dt) noexcept override {
    const HeldTool& held = hand_.follow(state);
    const double h = step_length(dt);
    contact_.update(contact, h);
    X_WT_ = approach_.at(held.X_WT, h);
    CouplingStep step;
    step.X_WT = X_WT_;
    step.X_WT_hand = held.X_WT;
    const Wrench F_C_W = contact_.exact_wrench(X_WT_);
    step.contact_W = F_C_W + friction_.step(contact, F_C_W, X_WT_, h);
    step.F_H_B = hand_.at_handle(step.contact_W);
    step.is_clutched = hand_.is_clutched();
    step.stored = (contact_.energy(X_WT_) + friction_.energy() + hand_.wall_energy()) / scale_;
    return step;
  }

 private:
  double scale_;
  Hand hand_;
  HeldContact contact_;
  MovedFriction friction_;
  Approach approach_;
  Pose X_WT_;
};

/// The tool follows the hand; its contact is reported, and the device gets no force.
class NoCoupling final : public Coupling {
 public:
  NoCoupling(const CouplingOptions& options, const MassProperties& tool)
      : hand_(options, tool.center_of_mass), friction_(options, {}, kStiffer, tool) {}

  void reset(const DeviceState& state) noexcept override {
    friction_.reset(hand_.follow(state).X_WT);
  }
  void take_over(const CouplingState& state) noexcept override {
    hand_.take_over(state);
    friction_.take_over(state);
  }
  CouplingState state() const noexcept override {
    const HeldTool& held = hand_.held();
    return {hand_.X_BH(),
            held.X_WT,
            held.X_WT,
            {held.velocity.linear, held.velocity.angular},
            friction_.state()};
  }
  Pose held_pose(const DeviceState& state) const noexcept override { return hand_.held_by(state); }
  CouplingStep step(const DeviceState& state, const LocalContact& contact,
                    double dt) noexcept override {
    CouplingStep step;
    step.X_WT = step.X_WT_hand = hand_.follow(state).X_WT;
    const Wrench met = contact.at(step.X_WT);
    step.contact_W = met + friction_.step(contact, met, step.X_WT, step_length(dt));
    return step;
  }
  bool drives_device() const noexcept override { return false; }

 private:
  Hand hand_;
  MovedFriction friction_;
};

}  // namespace

Pose handle_at(const CouplingOptions& options, const Pose& X_WT) noexcept {
  const auto& [X_WB, X_HT, scale] = std::tie(options.X_WB, options.X_HT, options.motion_scale);
  if (X_WB == Pose{} && X_HT == Pose{} && scale == 1) return X_WT;
  Pose X_BH = inverse(X_WB) * (X_WT * inverse(X_HT));
  X_BH.translation = X_BH.translation / scale;
  return X_BH;
}

std::unique_ptr<Coupling> make_no_coupling(const CouplingOptions& options,
                                           const MassProperties& tool) {
  return std::make_unique<NoCoupling>(options, tool);
}

std::unique_ptr<Coupling> make_direct_coupling(const CouplingOptions& options,
                                               const DeviceLimits& limits,
                                               const MassProperties& tool) {
  return std::make_unique<DirectCoupling>(options, limits, tool);
}

}}  // namespace palpate::v0
