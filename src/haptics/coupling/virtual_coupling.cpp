// A tool with mass, connected to the hand by a spring and damper.
//
// One step of backward Euler, linearized about the state before it (Otaduy and Lin 2006):
//
//   (M + dt (D + D_c) + dt^2 (K + K_c)) v = M v_0 + dt (K stretch + D v_hand + F_c)
//
// M, D, K: tool, damper, spring; F_c, K_c, D_c: contact. The matrices are no smaller than the true
// second derivatives (secant of the saturating spring, positive part of the contact stiffness), so
// a step adds no energy of its own, whatever dt and stiffness are. Terms in the velocity products
// are left out: the inertia turns with the tool about its own angular velocity, which alone keeps
// its energy. Friction is found in the same step, for the v that results.
#include <algorithm>

#include "src/haptics/coupling/couplings.h"
#include "src/haptics/coupling/rotated.h"
#include "src/haptics/internal/friction.h"

namespace palpate { inline namespace v0 {
namespace {

/// Damping ratio of the contact's stiffest direction: enough that the tool does not ring on it.
constexpr double kContactDampingRatio = 0.7;

/// Distance from the hand that no force causes, m: the contact was not usable.
constexpr double kLost = 1e6;

class VirtualCoupling final : public Coupling {
 public:
  VirtualCoupling(const CouplingOptions& options, const DeviceLimits& limits,
                  const MassProperties& tool)
      : scale_(options.motion_scale),
        spring_(make_spring(options, limits)),
        hand_(options, tool.center_of_mass),
        contact_(options.hold, radius_of_gyration(tool)),
        c_T_(tool.center_of_mass),
        mass_(options.tool_mass / options.motion_scale),
        friction_(friction_of(options, spring_, mass_)) {
    const double radius = radius_of_gyration(tool), mean = mass_ * radius * radius;
    for (int i = 0; i < 3; ++i) {
      for (int j = 0; j < 3; ++j) {
        const double own = tool.inertia.m[i][j] / tool.volume * mass_;
        inertia_T_.m[i][j] = std::isfinite(own) ? own : 0;
      }
      // Thin rods and dots turn about their axis too.
      inertia_T_.m[i][i] = std::max(inertia_T_.m[i][i], 1e-3 * mean);
    }
    // 2 zeta sqrt(m k), kept as a time: damping = time * stiffness, also where the spring
    // saturates.
    time_ = 2 * options.damping_ratio * std::sqrt(mass_ / spring_.stiffness);
    angular_time_ = 2 * options.damping_ratio * std::sqrt(mean / spring_.angular_stiffness);
  }

  void reset(const DeviceState& state) noexcept override {
    contact_.reset();
    friction_.reset();
    rest_at(hand_.follow(state));
  }
  void take_over(const CouplingState& state) noexcept override {
    contact_.reset();
    hand_.take_over(state);
    X_WT_ = state.X_WT;
    p_WC_ = X_WT_ * c_T_;
    velocity_ = {state.V_WT.linear, state.V_WT.angular};
    friction_.take_over(state.friction);
  }
  CouplingState state() const noexcept override {
    return {hand_.X_BH(),
            hand_.held().X_WT,
            X_WT_,
            {velocity_.linear, velocity_.angular},
            friction_.state()};
  }
  Pose held_pose(const DeviceState& state) const noexcept override { return hand_.held_by(state); }

  CouplingStep step(const DeviceState& state, const LocalContact& contact,
                    double dt) noexcept override {
    const HeldTool& held = hand_.follow(state);
    const double h = step_length(dt);
    contact_.update(contact, h);
    move(held, h);

    CouplingStep step;
    step.X_WT = X_WT_;
    step.X_WT_hand = held.X_WT;
    const Wrench F_C_W = contact_.exact_wrench(X_WT_);
    step.contact_W = to_wrench(to_vec6(F_C_W) + along_surface_ + damping_wrench(norm(F_C_W.force)));
    const Vec6 stretch = stretch_between(X_WT_, p_WC_, held);
    const Spring::Rates rates = spring_.rates(stretch);
    const Vec6 on_tool = rates * stretch + damping(rates) * (held.velocity - velocity_);
    step.F_H_B = hand_.at_handle(to_wrench(-1 * on_tool));
    step.is_clutched = hand_.is_clutched();
    step.stretch = norm(stretch.linear);
    step.energy = spring_.energy(stretch) / scale_;  // as the hand's side sees it
    step.stored = step.energy + (motion_energy() + contact_.energy(X_WT_) + friction_.energy() +
                                 hand_.wall_energy()) /
                                    scale_;
    return step;
  }

 private:
  /// Returns friction whose bristle is critically damped with the tool's mass.
  static PatchFriction friction_of(const CouplingOptions& options, const Spring& spring,
                                   double mass) {
    const double desired = options.friction.stiffness / options.motion_scale;
    const double stiffness = desired > 0 ? desired : kStiffer * spring.stiffness;
    return {options, stiffness, 2 * std::sqrt(mass / stiffness)};
  }

  void rest_at(const HeldTool& held) {
    X_WT_ = held.X_WT;
    p_WC_ = held.p_WC;
    velocity_ = {};
  }

  Spring::Rates damping(const Spring::Rates& rates) const {
    return {time_ * rates.linear, angular_time_ * rates.angular};
  }

  Mat6 mass_matrix() const {
    const Mat3d r = rotation_matrix(X_WT_.rotation);
    Mat6 mass;
    for (int i = 0; i < 3; ++i) {
      mass.m[i][i] = mass_;
      for (int j = 0; j < 3; ++j) {
        for (int k = 0; k < 3; ++k) {
          for (int l = 0; l < 3; ++l) {
            mass.m[i + 3][j + 3] += r.m[i][k] * inertia_T_.m[k][l] * r.m[j][l];
          }
        }
      }
    }
    return mass;
  }

  double motion_energy() const {
    const Vec6 momentum = mass_matrix() * velocity_;
    return (dot(velocity_.linear, momentum.linear) + dot(velocity_.angular, momentum.angular)) / 2;
  }

  void move(const HeldTool& held, double dt) {
    const Vec6 stretch = stretch_between(X_WT_, p_WC_, held);
    const Spring::Rates rates = spring_.rates(stretch), dampers = damping(rates);
    Mat6 a = mass_matrix();
    const Vec6 b = a * velocity_ + dt * (rates * stretch + dampers * held.velocity);
    for (int i = 0; i < 3; ++i) {
      a.m[i][i] += dt * (dampers.linear + dt * rates.linear);
      a.m[i + 3][i + 3] += dt * (dampers.angular + dt * rates.angular);
    }
    Vec6 velocity;
    along_surface_ = damped_ = {};
    if (!contact_.is_there()) friction_.reset();
    if (!(contact_.is_there() && solve_in_contact(a, b, dt, velocity)) && !solve(a, b, velocity)) {
      rest_at(held);
      return;
    }
    velocity_ = velocity;
    p_WC_ += dt * velocity.linear;
    X_WT_.rotation = rotated(X_WT_.rotation, dt * velocity.angular);
    X_WT_.translation = p_WC_ - rotate(X_WT_.rotation, c_T_);
    if (!is_finite(X_WT_) || !(norm(held.p_WC - p_WC_) < kLost)) rest_at(held);
  }

  /// False: the tool leaves the contact within the step and moves as if there were none.
  bool solve_in_contact(const Mat6& a, const Vec6& b, double dt, Vec6& velocity) {
    const LocalContact& contact = contact_.newest();
    if (friction_.is_on(contact)) return solve_with_friction(a, b, dt, velocity);
    const Vec6 wrench = to_vec6(contact_.wrench(X_WT_));
    const double resistance = dt + contact_damping_time();  // (dt K_c + D_c) v
    if (!solve(sum(a, dt * resistance, contact_.stiffness()), b + dt * wrench, velocity)) {
      return false;
    }
    const Vec6 end = wrench - resistance * (contact_.stiffness() * velocity);
    return contact_.pushes(to_wrench(end));
  }

  /// The same with friction and damping of the contact.
  bool solve_with_friction(const Mat6& a, const Vec6& b, double dt, Vec6& velocity) {
    const Vec6 wrench = to_vec6(contact_.wrench(X_WT_));
    const double resistance = dt + contact_damping_time();
    Mat6 sums = sum(a, dt * resistance, contact_.stiffness());
    TouchedPatch patch;
    const bool touches =
        friction_.touch(contact_.newest(), contact_.exact_wrench(X_WT_), dt, patch);
    if (touches) damp(dt, patch, sums);
    Factor6 factor;
    if (!factor.set(sums)) return false;
    velocity = factor.solve(b + dt * wrench);
    const Vec6 end = wrench - resistance * (contact_.stiffness() * velocity);
    if (!is_finite(velocity) || !contact_.pushes(to_wrench(end))) {
      friction_.reset();
      return false;
    }
    if (!touches) return true;
    Vec6 motions[3];
    Mat3s compliance = patch.compliance(factor, motions);
    for (double* number : {&compliance.xx, &compliance.xy, &compliance.xz, &compliance.yy,
                           &compliance.yz, &compliance.zz}) {
      *number *= dt * dt;
    }
    const auto grip = friction_.hold(patch, dt * patch.slid_by(velocity), compliance, dt);
    friction_.keep(patch, grip, dt);
    velocity = velocity + dt * (grip.force.x * motions[0] + grip.force.y * motions[1] +
                                grip.force.z * motions[2]);
    along_surface_ = patch.wrench(grip.force);
    return is_finite(velocity);
  }

  /// Damping along the normal, as much as the speed before allows.
  void damp(double dt, TouchedPatch& patch, Mat6& sums) {
    const Vec6& n = patch.approach;
    const double speed = dot(n.linear, velocity_.linear) + dot(n.angular, velocity_.angular);
    const double damping = friction_.contact_damping(patch.normal_force, speed);
    if (!(damping > 0)) return;
    for (int i = 0; i < 6; ++i) {
      for (int j = 0; j < 6; ++j) sums.m[i][j] += dt * damping * n[i] * n[j];
    }
    const double share = 1 - damping * speed / patch.normal_force;
    patch.limit *= share;
    patch.slope *= share;
    damping_ = damping;
    damped_ = n;
  }
  /// Returns the wrench of that damping; at most it takes away the contact's own force.
  Vec6 damping_wrench(double normal_force) const {
    const double speed =
        dot(damped_.linear, velocity_.linear) + dot(damped_.angular, velocity_.angular);
    return std::max(-damping_ * speed, -normal_force) * damped_;
  }

  double contact_damping_time() const {
    const double k_max = contact_.max_stiffness();
    return k_max > 0 ? 2 * kContactDampingRatio * std::sqrt(mass_ / k_max) : 0;
  }

  double scale_;
  Spring spring_;
  Hand hand_;
  HeldContact contact_;
  Vec3d c_T_;
  double mass_;  // in the tool's world, as all members below
  PatchFriction friction_;
  Vec6 along_surface_;  // friction of the last step, on the tool
  Vec6 damped_;         // direction in which the contact was damped then, and how much, N s/m
  double damping_ = 0;
  Mat3d inertia_T_;  // kg m2
  double time_ = 0, angular_time_ = 0;
  Pose X_WT_;
  Vec3d p_WC_;
  Vec6 velocity_;
};

}  // namespace

std::unique_ptr<Coupling> make_virtual_coupling(const CouplingOptions& options,
                                                const DeviceLimits& limits,
                                                const MassProperties& tool) {
  return std::make_unique<VirtualCoupling>(options, limits, tool);
}

}}  // namespace palpate::v0
