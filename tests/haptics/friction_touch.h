// A hand that moves a tool over a plate, by every coupling: for tests of friction.
#pragma once

#include <gtest/gtest.h>

#include <memory>

#include "palpate/haptics/coupling.h"
#include "src/math/internal/matrix6.h"
#include "src/math/internal/rotation_vector.h"
#include "tests/haptics/coupled_box.h"

namespace palpate::test {

using coupled_box::kTick;
inline const DeviceLimits kLimits{.max_force = 20,
                                  .max_torque = 2,
                                  .max_stiffness = 2000,
                                  .max_angular_stiffness = 20,
                                  .max_damping = 30,
                                  .workspace_radius = 0.1,
                                  .damping = 1,
                                  .angular_damping = 2e-2};
/// Those that give the hand a force.
inline constexpr CouplingKind kCouplings[] = {CouplingKind::virtual_coupling, CouplingKind::proxy,
                                              CouplingKind::direct};
inline constexpr CouplingKind kAll[] = {CouplingKind::virtual_coupling, CouplingKind::proxy,
                                        CouplingKind::direct, CouplingKind::none};

/// A box of 2 x 4 x 6 cm about its middle.
inline MassProperties box_tool() {
  MassProperties tool = coupled_box::box_tool();
  tool.center_of_mass = {};
  return tool;
}

inline CouplingOptions options_of(CouplingKind kind, double coefficient) {
  CouplingOptions options;
  options.kind = kind;
  options.friction.coefficient = coefficient;
  const auto checked = check_coupling(options, kLimits, kTick, box_tool());
  EXPECT_TRUE(checked.has_value()) << checked.error().message;
  return checked->options;
}

inline DeviceState hand_at(const Pose& X_BH) {
  DeviceState state;
  state.X_BH = X_BH;
  state.is_valid = true;
  return state;
}

/// A plane that pushes a foot of the tool, which is a patch with a torsion radius, along its
/// normal: as stiff in depth as `k` says, and in tilt as such a patch is.
struct Plate {
  Vec3d n_W{0, 0, 1};
  double offset = 0, k = 3000;
  Vec3d foot_T{0, 0, -0.03};
  double torsion_radius = 0.01;
  double scale = 1;  // noise

  LocalContact contact(const Pose& X_WT, double time) const {
    LocalContact contact;
    contact.is_valid = true;
    contact.time = time;
    contact.X_WT = X_WT;
    contact.p_WC = X_WT.translation;
    const double depth = offset - dot(n_W, X_WT * foot_T);
    if (!(depth > 0)) return contact;
    const Vec3d lever = rotate(X_WT.rotation, foot_T);
    const Vec6 along{n_W, cross(lever, n_W)};
    contact.F_C_W = {scale * k * depth * along.linear, scale * k * depth * along.angular};
    for (int i = 0; i < 6; ++i) {
      for (int j = 0; j < 6; ++j) contact.stiffness.m[i][j] = k * along[i] * along[j];
    }
    contact.max_stiffness = k;
    contact.energy = scale * k * depth * depth / 2;
    contact.volume = 1e-4 * depth;
    contact.patch.lever_W = lever;
    contact.patch.torsion_radius = torsion_radius;
    return contact;
  }
};

/// Contact of a hand that moves as it is told, measured anew where the tool is at every tick.
class Touch {
 public:
  Touch(const CouplingOptions& options, const Plate& touched, const Pose& start)
      : options_(options), plate(touched), coupling(make_coupling(options, kLimits, box_tool())) {
    coupling->reset(hand_at(start));
    step.X_WT = last_ = start;
  }
  const CouplingStep& to(const Pose& X_BH) {
    if (options_.kind == CouplingKind::none) step.X_WT = X_BH;  // measured first
    const LocalContact contact = plate.contact(step.X_WT, time_);
    normal = contact.F_C_W;
    DeviceState state = hand_at(X_BH);
    state.V_BH = {(X_BH.translation - last_.translation) / kTick,
                  rotation_between(last_.rotation, X_BH.rotation) / kTick};
    last_ = X_BH;
    step = coupling->step(state, contact, kTick);
    time_ += kTick;
    return step;
  }
  void go_on_as(const Touch& other) {
    step = other.step;
    last_ = other.last_;
    time_ = other.time_;
  }
  /// Returns the force of friction, along the plate.
  Vec3d along() const {
    const Vec3d f = step.contact_W.force;
    return f - dot(f, plate.n_W) * plate.n_W;
  }
  double turning() const {
    return dot(step.contact_W.torque - cross(lever(), step.contact_W.force), plate.n_W);
  }
  Vec3d lever() const { return rotate(step.X_WT.rotation, plate.foot_T); }

 private:
  CouplingOptions options_;
  double time_ = 0;
  Pose last_;

 public:
  Plate plate;
  std::unique_ptr<Coupling> coupling;
  CouplingStep step;
  Wrench normal;
};

/// Returns the pose of a hand that presses by `depth`.
inline Pose pressed(double depth, const Vec3d& aside = {}) {
  return {Vec3d{0, 0, 0.03 - depth} + aside, {}};
}

}  // namespace palpate::test
