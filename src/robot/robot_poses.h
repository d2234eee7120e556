// Configurations of a robot, some at a time: positions held within their limits, and where links
// are.
#pragma once

#include <cmath>
#include <cstdint>
#include <span>
#include <vector>

#include "palpate/robot/robot.h"
#include "src/robot/place_links.h"
#include "src/robot/robot_data.h"

namespace palpate { inline namespace v0 {

/// Returns a pose with a rotation of length 1; without a change if it is that within rounding.
inline Pose with_unit_rotation(const Pose& X) {
  const Quaternion& q = X.rotation;
  const double square = q.x * q.x + q.y * q.y + q.z * q.z + q.w * q.w;
  return std::abs(square - 1) < 1e-12 ? X : Pose{X.translation, normalized(q)};
}

/// Links of some configurations. Eight of them are placed at a time, by vectors.
class RobotPlaces {
 public:
  explicit RobotPlaces(Isa isa = best_isa());

  /// Makes room for `num` configurations.
  void resize(const Robot::Data& robot, std::size_t num);
  /// Number of blocks of configurations.
  std::size_t num_blocks() const;
  /// Places all links of a block; any number of threads, each with another block. `joints`: num x n
  /// positions, held within their limits where they are beyond. Writes X_WL, num x L.
  void place(const Robot::Data& robot, std::size_t block, std::span<const double> joints,
             const Pose& X_WB, std::span<Pose> X_WL);

  /// 1 if a joint was beyond its limits.
  std::uint8_t held(std::size_t configuration) const { return held_[configuration]; }
  /// Returns the pose of a link of the model.
  Pose X_BL(std::size_t configuration, std::size_t link) const;

 private:
  void (*place_links_)(const PlaceJob&);
  std::size_t num_links_ = 0;      // of the model
  std::vector<JointMoves> moves_;  // of each block and joint of the model
  std::vector<PlacedLink> links_;  // of each block and link of the model
  std::vector<std::uint8_t> held_;
};

/// Errors: not P x n positions; one is not finite; one is beyond its limits and `refuses`; the base
/// is nowhere. Positions on a GPU are not looked at.
Status check_joints(const Robot::Data& robot, const RobotPoses& poses);
/// Returns what is wrong with position number i of all, which is not finite or beyond its limits.
Error refused_joint(const Robot::Data& robot, std::size_t i, double position);

/// Adds, for each joint that moves a limb, what a force and a torque about the limb's point C (in
/// W) do to it: J^T (force, torque). `to` has n numbers.
void add_joint_torque(const Robot::Data& robot, const RobotLimb& limb, const RobotPlaces& places,
                      std::size_t configuration, const Pose& X_WB, const Vec3d& C_W,
                      const Vec3d& force, const Vec3d& torque, double* to);

}}  // namespace palpate::v0
