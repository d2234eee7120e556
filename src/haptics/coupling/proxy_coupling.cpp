// A tool without mass: at every tick it is where the spring and the contact balance. The contact's
// stiffness against the spring's keeps it out of the surface, and the hand feels the spring.
#include "src/haptics/approach.h"
#include "src/haptics/coupling/couplings.h"
#include "src/haptics/coupling/rotated.h"
#include "src/haptics/internal/friction.h"

namespace palpate { inline namespace v0 {
namespace {

constexpr int kMaxIterations = 8;       // the spring may saturate on the way: two or three do
constexpr double kSmallestStep = 1e-9;  // m

/// Motion larger than any that a contact causes, m.
constexpr double kLost = 1e6;

class ProxyCoupling final : public Coupling {
 public:
  ProxyCoupling(const CouplingOptions& options, const DeviceLimits& limits,
                const MassProperties& tool)
      : scale_(options.motion_scale),
        spring_(make_spring(options, limits)),
        hand_(options, tool.center_of_mass),
        contact_(ContactHold::local_model, radius_of_gyration(tool)),
        friction_(options, kStiffer * spring_.stiffness, 0),
        approach_(tool.center_of_mass),
        c_T_(tool.center_of_mass),
        radius_(radius_of_gyration(tool)) {}

  void reset(const DeviceState& state) noexcept override {
    contact_.reset();
    friction_.reset();
    X_WT_ = X_WT_shown_ = hand_.follow(state).X_WT;
    velocity_ = {};
  }
  void take_over(const CouplingState& state) noexcept override {
    contact_.reset();
    hand_.take_over(state);
    X_WT_ = X_WT_shown_ = state.X_WT;
    velocity_ = {state.V_WT.linear, state.V_WT.angular};
    friction_.take_over(state.friction);
    approach_.begin(X_WT_);
  }
  CouplingState state() const noexcept override {
    return {hand_.X_BH(),
            hand_.held().X_WT,
            X_WT_shown_,
            {velocity_.linear, velocity_.angular},
            friction_.state()};
  }
  Pose held_pose(const DeviceState& state) const noexcept override { return hand_.held_by(state); }

  CouplingStep step(const DeviceState& state, const LocalContact& contact,
                    double dt) noexcept override {
    const HeldTool& held = hand_.follow(state);
    const double h = step_length(dt);
    contact_.update(contact, h);
    balance(held, h);
    show(approach_.at(X_WT_, h), h);

    CouplingStep step;
    step.X_WT = X_WT_shown_;
    step.X_WT_hand = held.X_WT;
    const Wrench F_C_W = contact_.exact_wrench(X_WT_shown_);
    step.contact_W = {F_C_W.force + along_surface_.linear, F_C_W.torque + along_surface_.angular};
    const Vec6 stretch = stretch_between(X_WT_shown_, X_WT_shown_ * c_T_, held);
    step.F_H_B = hand_.at_handle(to_wrench(-1 * (spring_.rates(stretch) * stretch)));
    step.is_clutched = hand_.is_clutched();
    step.stretch = norm(stretch.linear);
    step.energy = spring_.energy(stretch) / scale_;
    step.stored =
        step.energy +
        (contact_.energy(X_WT_shown_) + friction_.energy() + hand_.wall_energy()) / scale_;
    return step;
  }

 private:
  void show(const Pose& X_WT, double dt) {
    if (dt > 0) {
      velocity_ = (1 / dt) * Vec6{X_WT * c_T_ - X_WT_shown_ * c_T_,
                                  rotation_between(X_WT_shown_.rotation, X_WT.rotation)};
    }
    X_WT_shown_ = X_WT;
  }

  /// Newton's method on spring + contact = 0, from where the tool was.
  void balance(const HeldTool& held, double dt) {
    along_surface_ = {};
    Vec6 moved;  // since the last tick
    PatchFriction::Grip grip;
    const bool has_friction = contact_.is_there() && friction_.is_on(contact_.newest());
    TouchedPatch patch;
    const bool touches =
        has_friction && friction_.touch(contact_.newest(), contact_.exact_wrench(X_WT_), dt, patch);
    if (!contact_.is_there()) friction_.reset();
    for (int i = 0; i < kMaxIterations; ++i) {
      Vec6 move;
      if (!find_move(held, touches ? &patch : nullptr, moved, dt, grip, move) ||
          !(norm(move.linear) < kLost)) {
        friction_.reset();
        along_surface_ = {};
        X_WT_ = held.X_WT;
        return;
      }
      moved = moved + move;
      const Vec3d p_WC = X_WT_ * c_T_ + move.linear;
      X_WT_.rotation = rotated(X_WT_.rotation, move.angular);
      X_WT_.translation = p_WC - rotate(X_WT_.rotation, c_T_);
      if (norm(move.linear) + radius_ * norm(move.angular) < kSmallestStep) break;
    }
    if (!touches) return;
    friction_.keep(patch, grip, dt);
    along_surface_ = patch.wrench(grip.force);
  }

  /// False: nothing holds the tool, it is at the hand.
  bool find_move(const HeldTool& held, const TouchedPatch* patch, const Vec6& moved, double dt,
                 PatchFriction::Grip& grip, Vec6& move) const {
    if (!contact_.is_there()) return false;
    const Vec6 stretch = stretch_between(X_WT_, X_WT_ * c_T_, held);
    const Spring::Rates rates = spring_.rates(stretch);
    const Vec6 wrench = to_vec6(contact_.wrench(X_WT_));
    Mat6 a = contact_.stiffness();
    for (int i = 0; i < 3; ++i) {
      a.m[i][i] += rates.linear;
      a.m[i + 3][i + 3] += rates.angular;
    }
    Factor6 factor;
    if (!factor.set(a)) return false;
    move = factor.solve(rates * stretch + wrench);
    if (!is_finite(move) || !contact_.pushes(to_wrench(wrench - contact_.stiffness() * move))) {
      return false;
    }
    if (patch == nullptr) return true;
    Vec6 motions[3];
    const Mat3s compliance = patch->compliance(factor, motions);
    grip = friction_.hold(*patch, patch->slid_by(moved + move), compliance, dt);
    move = move + grip.force.x * motions[0] + grip.force.y * motions[1] + grip.force.z * motions[2];
    return true;
  }

  double scale_;
  Spring spring_;
  Hand hand_;
  HeldContact contact_;
  PatchFriction friction_;
  Vec6 along_surface_;  // friction of the last tick, on the tool
  Approach approach_;
  Vec3d c_T_;
  double radius_;
  Pose X_WT_;        // at equilibrium
  Pose X_WT_shown_;  // reported: the same, unless it has just taken over
  Vec6 velocity_;
};

}  // namespace

std::unique_ptr<Coupling> make_proxy_coupling(const CouplingOptions& options,
                                              const DeviceLimits& limits,
                                              const MassProperties& tool) {
  return std::make_unique<ProxyCoupling>(options, limits, tool);
}

}}  // namespace palpate::v0
