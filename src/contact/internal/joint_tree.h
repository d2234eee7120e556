// A tree of joints that places the tools of a contact, and questions about its configurations,
// which go from joints to answers on a GPU.
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <optional>
#include <span>
#include <vector>

#include "palpate/contact/scene.h"
#include "src/math/internal/joint_motion.h"

namespace palpate { inline namespace v0 {

/// rad or m: positions are nearer to 0.
inline constexpr double kMaxJointPosition = 1e6;

/// A joint of a tree. Frame 0 is the base, and joint k places frame k + 1.
struct TreeJoint {
  JointKind kind = JointKind::fixed;
  std::int32_t parent = 0;  ///< frame; no later one than k
  /// Its position is factor * that of this number + offset; -1: the offset alone.
  std::int32_t moved = -1;
  double factor = 1, offset = 0;
  Pose X_PJ;
  Vec3d axis{1, 0, 0};
};

/// Positions are held within these, rad or m.
struct JointRange {
  double lower = 0, upper = 0;
};

/// Frames of tools, moved by n positions. Immutable.
struct JointTree {
  std::vector<TreeJoint> joints;
  std::vector<JointRange> ranges;           ///< n
  std::vector<std::int32_t> frame_of_tool;  ///< of each tool of a contact
};

/// Positions of P configurations.
struct JointPoses {
  std::shared_ptr<const JointTree> tree;
  Pose X_WB;                          ///< of the base
  std::span<const double> positions;  ///< P x n
  bool refuses_beyond_ranges = false;
  int gpu = kHostMemory;  ///< memory of the positions and of all answers
};

/// Row-major arrays of the caller; null: not computed.
struct TreeAnswers {
  double* clearance = nullptr;           ///< P, m: the least of all tools
  std::int32_t* link = nullptr;          ///< P: the tool that has it; -1: none is within the limit
  double* clearance_by_joint = nullptr;  ///< P x n: its derivative
  std::uint8_t* held = nullptr;          ///< P: 1 if a position was beyond its range
  /// P: 1 if a clearance is below the limit, which is any number then. Without the first three.
  std::uint8_t* hits = nullptr;
  double limit = kClearanceLimit;  ///< m
};

/// A position that no tree takes: beyond its range, or not within kMaxJointPosition.
struct RefusedPosition {
  std::size_t number = 0;  ///< of all positions
  double value = 0;
};

/// Measures the tools of a contact on a GPU at P configurations; poses of links stay there. Waits.
/// Returns the first position that is refused: then there is no result. Errors: as of
/// SceneContact::measure; a contact on a CPU; positions of another GPU.
Result<std::optional<RefusedPosition>> measure_tree(const SceneContact& contact, const Scene& scene,
                                                    const JointPoses& poses,
                                                    const TreeAnswers& answers);

}}  // namespace palpate::v0
