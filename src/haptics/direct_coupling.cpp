// The tool is at the hand: which feels the contact itself (a penalty method, as stiff as the
// contact), or nothing.
#include "src/haptics/approach.h"
#include "src/haptics/couplings.h"

namespace palpate {
namespace {

class DirectCoupling final : public Coupling {
 public:
  DirectCoupling(const CouplingOptions& options, const MassProperties& tool)
      : hand_(options, tool.centre_of_mass),
        contact_(options.hold, radius_of_gyration(tool)),
        approach_(tool.centre_of_mass) {}

  void reset(const DeviceState& state) noexcept override {
    X_WT_ = hand_.follow(state).X_WT;
    contact_.reset();
  }
  void take_over(const CouplingState& state) noexcept override {
    hand_.take_over(state);
    contact_.reset();
    X_WT_ = state.X_WT;
    approach_.begin(X_WT_);
  }
  CouplingState state() const noexcept override {
    const HeldTool& held = hand_.held();
    return {hand_.X_BH(), held.X_WT, X_WT_, {held.velocity.linear, held.velocity.angular}};
  }

  void remember(StateNumbers& numbers) noexcept override {
    numbers(hand_, contact_, approach_, X_WT_);
  }

  CouplingStep step(const DeviceState& state, const LocalContact& contact,
                    double dt) noexcept override {
    const HeldTool& held = hand_.follow(state);
    contact_.update(contact, step_length(dt));
    X_WT_ = approach_.at(held.X_WT, step_length(dt));
    CouplingStep step;
    step.X_WT = X_WT_;
    step.X_WT_hand = held.X_WT;
    step.contact_W = contact_.felt(X_WT_);
    step.F_H_B = hand_.at_handle(step.contact_W);
    return step;
  }

 private:
  Hand hand_;
  HeldContact contact_;
  Approach approach_;
  Pose X_WT_;
};

/// The tool is moved, and what it meets is told.
class NoCoupling final : public Coupling {
 public:
  NoCoupling(const CouplingOptions& options, const MassProperties& tool)
      : hand_(options, tool.centre_of_mass) {}

  void reset(const DeviceState& state) noexcept override { hand_.follow(state); }
  void take_over(const CouplingState& state) noexcept override { hand_.take_over(state); }
  CouplingState state() const noexcept override {
    const HeldTool& held = hand_.held();
    return {hand_.X_BH(), held.X_WT, held.X_WT, {held.velocity.linear, held.velocity.angular}};
  }
  void remember(StateNumbers& numbers) noexcept override { numbers(hand_); }
  CouplingStep step(const DeviceState& state, const LocalContact& contact,
                    double) noexcept override {
    CouplingStep step;
    step.X_WT = step.X_WT_hand = hand_.follow(state).X_WT;
    step.contact_W = contact.at(step.X_WT);
    return step;
  }
  bool is_felt() const noexcept override { return false; }

 private:
  Hand hand_;
};

}  // namespace

Pose prescribed_pose(const CouplingOptions& options, const DeviceState& state) noexcept {
  return Hand(options, {}).follow(state).X_WT;
}

std::unique_ptr<Coupling> make_no_coupling(const CouplingOptions& options,
                                           const MassProperties& tool) {
  return std::make_unique<NoCoupling>(options, tool);
}

std::unique_ptr<Coupling> make_direct_coupling(const CouplingOptions& options,
                                               const MassProperties& tool) {
  return std::make_unique<DirectCoupling>(options, tool);
}

}  // namespace palpate
