// From the device's handle to the tool and back.
//
// With a motion scale the tool lives in a world that the hand sees 1 / scale times as large: forces
// are the same on both sides, lengths and so torques differ by the scale. Power then differs by one
// factor for force and torque alike, and what is passive for the tool is passive for the hand.
#pragma once

#include "palpate/haptics/coupling.h"
#include "src/haptics/internal/matrix6.h"

namespace palpate {

/// The tool as the hand holds it.
struct HeldTool {
  Pose X_WT;
  Vec3d p_WC, p_WH;  ///< centre of mass, handle
  Vec6 velocity;     ///< of the centre of mass, in W
};

class Hand {
 public:
  Hand(const CouplingOptions& options, const Vec3d& centre_of_mass_T)
      : options_(options), c_T_(centre_of_mass_T) {}

  /// Goes on with the tool in the hand where it was.
  void take_over(const CouplingState& state) noexcept;
  /// A state that is not valid or not finite leaves the hand where it was, at rest.
  const HeldTool& follow(const DeviceState& state) noexcept;
  /// What a wrench on the held tool, about its centre of mass, is at the handle in B.
  Wrench at_handle(const Wrench& F_C_W) const noexcept;

  void remember(StateNumbers& numbers) noexcept {
    numbers(held_.X_WT, held_.p_WC, held_.p_WH, held_.velocity.linear, held_.velocity.angular,
            X_BH_, shift_W_);
  }

  const HeldTool& held() const noexcept { return held_; }
  /// The last usable one.
  const Pose& X_BH() const noexcept { return X_BH_; }

 private:
  CouplingOptions options_;
  Vec3d c_T_;
  HeldTool held_;
  Pose X_BH_;
  Vec3d shift_W_;  // of all poses: where the tool was when the motion scale was changed
};

}  // namespace palpate
