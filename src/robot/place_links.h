// Forward kinematics of some configurations at once: vectors with a configuration in each lane,
// which have the bits of RobotModel::place, whatever the instruction set.
#pragma once

#include <cstddef>

#include "src/cameras/internal/robot_model.h"

namespace palpate { inline namespace v0 {

/// Configurations that are placed together.
inline constexpr int kPlacedTogether = 8;

/// The motion of a joint.
struct JointMoves {
  Vec3d axis;
  /// Sine and cosine of half the angle; position of a sliding one.
  double by[2][kPlacedTogether] = {};
};

/// Pose X_BL of a link: translation x y z, rotation x y z w.
struct PlacedLink {
  double numbers[7][kPlacedTogether];
};

/// Arguments of a placement.
struct PlaceJob {
  const RobotJoint* joints = nullptr;
  const JointMoves* moves = nullptr;
  std::size_t num_joints = 0, root = 0;
  PlacedLink* X_BL = nullptr;  ///< of all links of the model
  Pose X_WB;
  const std::size_t* limbs = nullptr;  ///< links of the model
  std::size_t num_limbs = 0;
  Pose* X_WL = nullptr;  ///< num x num_limbs
  int num = 0;           ///< configurations
};

}}  // namespace palpate::v0
