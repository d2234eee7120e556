// Default placement of a device in the world.
#pragma once

#include "palpate/haptics/coupling.h"

namespace palpate { inline namespace v0 {

/// Places the center of the device's workspace at the tool's first pose, with the tool as it is
/// there. The hand moves as in the picture of the camera: devices have x to the right, y up and z
/// toward the hand, cameras look along z with y down.
inline void place_hand(const Pose& X_WC, const Pose& X_WT, CouplingOptions& coupling) {
  constexpr Quaternion kHalfTurnAboutX{1, 0, 0, 0};
  const Quaternion q_WB = X_WC.rotation * kHalfTurnAboutX;
  coupling.X_WB = {X_WT.translation, q_WB};
  coupling.X_HT.rotation = normalized(conjugate(q_WB) * X_WT.rotation);
}

}}  // namespace palpate::v0
