// The tool is at the hand, which feels the contact itself: a penalty method, as stiff as the
// contact.
#include "src/haptics/couplings.h"

namespace palpate {
namespace {

class DirectCoupling final : public Coupling {
 public:
  DirectCoupling(const CouplingOptions& options, const MassProperties& tool)
      : hand_(options, tool.centre_of_mass), contact_(options.hold, radius_of_gyration(tool)) {}

  void reset(const DeviceState& state) noexcept override {
    hand_.follow(state);
    contact_.reset();
  }

  CouplingStep step(const DeviceState& state, const LocalContact& contact,
                    double dt) noexcept override {
    const HeldTool& held = hand_.follow(state);
    contact_.update(contact, step_length(dt));
    CouplingStep step;
    step.X_WT = step.X_WT_hand = held.X_WT;
    step.contact_W = contact_.felt(held.X_WT);
    step.F_H_B = hand_.at_handle(step.contact_W);
    return step;
  }

 private:
  Hand hand_;
  HeldContact contact_;
};

}  // namespace

std::unique_ptr<Coupling> make_direct_coupling(const CouplingOptions& options,
                                               const MassProperties& tool) {
  return std::make_unique<DirectCoupling>(options, tool);
}

}  // namespace palpate
