// From the device's handle to the tool and back.
//
// With a motion scale the tool is in a world that the hand sees 1 / scale times as large: forces
// are the same on both sides, lengths and so torques differ by the scale. Power then differs by one
// factor for force and torque alike, and what is passive for the tool is passive for the hand.
//
// With the clutch pressed the hand moves without the tool and feels nothing; on release it holds
// the tool where that is. Walls keep the held tool in its workspace, and the hand feels them.
//
// In ticks without a usable state the hand keeps its velocity, for ten milliseconds.
#pragma once

#include "palpate/haptics/coupling.h"
#include "src/haptics/internal/matrix6.h"

namespace palpate { inline namespace v0 {

/// The tool as the hand holds it.
struct HeldTool {
  Pose X_WT;
  Vec3d p_WC, p_WH;  ///< center of mass, handle
  Vec6 velocity;     ///< of the center of mass, in W
};

class Hand {
 public:
  Hand(const CouplingOptions& options, const Vec3d& center_of_mass_T);

  /// Continues with the tool in the hand where it was.
  void take_over(const CouplingState& state) noexcept;
  /// Moves the held tool with the device. A state that is not valid or not finite has no pose: the
  /// hand is extrapolated to its time, and after a while stands still.
  const HeldTool& follow(const DeviceState& state) noexcept;
  /// Returns the X_WT that `follow` would return, and changes nothing.
  Pose held_by(const DeviceState& state) const noexcept;
  /// Returns the wrench at the handle, in B: of F_C_W, about the center of mass, and of the walls.
  Wrench at_handle(const Wrench& F_C_W) const noexcept;
  /// Returns the energy stored in the walls of the workspace, J, in the tool's world.
  double wall_energy() const noexcept;

  const HeldTool& held() const noexcept { return held_; }
  bool is_clutched() const noexcept { return is_clutched_; }
  /// Returns the pose of the hand, extrapolated in ticks without a usable state.
  const Pose& X_BH() const noexcept { return X_BH_; }

 private:
  double wall_stiffness() const noexcept { return options_.wall_stiffness / options_.motion_scale; }
  bool is_usable(const DeviceState& state) const noexcept;
  void go_on(double time) noexcept;
  Vec6 velocity_of(const Twist& V_BH) const noexcept;
  bool is_clutch_pressed(const DeviceState& state) const noexcept;
  void hold(const Pose& X_WT) noexcept;
  void place(const Pose& X_BH) noexcept;
  Vec3d beyond_workspace(const Vec3d& p_W) const noexcept;

  CouplingOptions options_;
  Vec3d c_T_;
  Pose X_HT_inverse_;
  HeldTool held_;
  Pose X_BH_;
  // The last usable state.
  Pose seen_X_BH_;
  Twist V_BH_;
  double seen_time_ = 0;  // s
  // Offset of the tool from the hand since the motion scale was changed or the hand took hold of
  // it: a shift of all poses, and the rotation of the tool in the hand.
  Vec3d shift_W_;
  Quaternion turn_;
  Vec3d excess_B_;  // beyond the workspace, in the tool's world
  bool is_clutched_ = false, has_pose_ = false;
};

}}  // namespace palpate::v0
