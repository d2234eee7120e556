// A tool with mass, on a spring and damper that the hand holds the other end of.
//
// One step of backward Euler, linearised about the state before it (Otaduy and Lin 2006):
//
//   (M + dt (D + D_c) + dt^2 (K + K_c)) v = M v_0 + dt (K stretch + D v_hand + F_c)
//
// M, D, K: tool, damper, spring; F_c, K_c, D_c: contact. The matrices are no smaller than the true
// second derivatives (secant of the saturating spring, positive part of the contact stiffness), so
// a step adds no energy of its own, whatever dt and stiffness are. Terms in the velocity products
// are left out: the inertia turns with the tool about its own angular velocity, which alone keeps
// its energy.
#include <algorithm>

#include "src/haptics/couplings.h"
#include "src/haptics/rotated.h"

namespace palpate {
namespace {

/// Of the stiffest direction of the contact: enough that the tool does not ring on it.
constexpr double kContactDampingRatio = 0.7;

/// As far from the hand as no force brings it, m: what has come in was no contact.
constexpr double kLost = 1e6;

class VirtualCoupling final : public Coupling {
 public:
  VirtualCoupling(const CouplingOptions& options, const DeviceLimits& limits,
                  const MassProperties& tool)
      : scale_(options.motion_scale),
        spring_(make_spring(options, limits)),
        hand_(options, tool.centre_of_mass),
        contact_(options.hold, radius_of_gyration(tool)),
        c_T_(tool.centre_of_mass),
        mass_(options.tool_mass / options.motion_scale) {
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
    rest_at(hand_.follow(state));
  }
  void take_over(const CouplingState& state) noexcept override {
    contact_.reset();
    hand_.take_over(state);
    X_WT_ = state.X_WT;
    p_WC_ = X_WT_ * c_T_;
    velocity_ = {state.V_WT.linear, state.V_WT.angular};
  }
  CouplingState state() const noexcept override {
    return {hand_.X_BH(), hand_.held().X_WT, X_WT_, {velocity_.linear, velocity_.angular}};
  }

  void remember(StateNumbers& numbers) noexcept override {
    numbers(hand_, contact_, X_WT_, p_WC_, velocity_.linear, velocity_.angular);
  }

  CouplingStep step(const DeviceState& state, const LocalContact& contact,
                    double dt) noexcept override {
    const HeldTool& held = hand_.follow(state);
    const double h = step_length(dt);
    contact_.update(contact, h);
    move(held, h);

    CouplingStep step;
    step.X_WT = X_WT_;
    step.X_WT_hand = held.X_WT;
    step.contact_W = contact_.felt(X_WT_);
    const Vec6 stretch = stretch_between(X_WT_, p_WC_, held);
    const Spring::Rates rates = spring_.rates(stretch);
    const Vec6 on_tool = rates * stretch + damping(rates) * (held.velocity - velocity_);
    step.F_H_B = hand_.at_handle(to_wrench(-1 * on_tool));
    step.stretch = norm(stretch.linear);
    step.energy = spring_.energy(stretch) / scale_;  // as the hand's side sees it
    return step;
  }

 private:
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
  bool solve_in_contact(const Mat6& a, const Vec6& b, double dt, Vec6& velocity) const {
    const Vec6 wrench = to_vec6(contact_.wrench(X_WT_));
    const double k_max = contact_.max_stiffness();
    const double damping_time = k_max > 0 ? 2 * kContactDampingRatio * std::sqrt(mass_ / k_max) : 0;
    const double resistance = dt + damping_time;  // (dt K_c + D_c) v
    if (!solve(sum(a, dt * resistance, contact_.stiffness()), b + dt * wrench, velocity)) {
      return false;
    }
    const Vec6 end = wrench - resistance * (contact_.stiffness() * velocity);
    return contact_.pushes(to_wrench(end));
  }

  double scale_;
  Spring spring_;
  Hand hand_;
  HeldContact contact_;
  Vec3d c_T_;
  double mass_;      // in the tool's world, as all that follows
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

}  // namespace palpate
