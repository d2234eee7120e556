// Configurations of a robot, some at a time: positions held within their limits, and where links
// are.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "palpate/robot/robot.h"
#include "src/robot/robot_data.h"

namespace palpate { inline namespace v0 {

/// Links of one configuration in the world.
struct RobotPlaces {
  std::vector<double> positions;  ///< of each joint of the model
  std::vector<Pose> X_BL;         ///< of each link of the model
  /// Places all links. `joints`: n positions, held within their limits where they are beyond.
  /// Returns true if one was.
  bool place(const Robot::Data& robot, std::span<const double> joints);
};

/// Errors: not P x n positions; one is not finite; one is beyond its limits and `refuses`; the base
/// is nowhere. Positions on a GPU are not looked at.
Status check_joints(const Robot::Data& robot, const RobotPoses& poses);
/// Returns what is wrong with position number i of all, which is not finite or beyond its limits.
Error refused_joint(const Robot::Data& robot, std::size_t i, double position);

/// Adds, for each joint that moves a limb, what a force and a torque about the limb's point C (in
/// W) do to it: J^T (force, torque). `places` are of this configuration; `to` has n numbers.
void add_joint_torque(const Robot::Data& robot, const RobotLimb& limb, const RobotPlaces& places,
                      const Pose& X_WB, const Vec3d& C_W, const Vec3d& force, const Vec3d& torque,
                      double* to);

}}  // namespace palpate::v0
