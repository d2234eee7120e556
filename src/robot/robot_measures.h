// Buffers for measuring a robot in a scene: places of its links, and answers for each of them.
#pragma once

#include <cstdint>
#include <memory>
#include <utility>
#include <vector>

#include "src/robot/robot_poses.h"

namespace palpate { inline namespace v0 {

/// Answers for links, a row for each configuration, and what they mean for the robot.
struct RobotMeasures {
  std::vector<double> clearance, gradient, volume, force, torque, unseen;
  std::vector<std::int32_t> nearest;

  /// Arrays for what `to` needs.
  SceneAnswers make_room(const RobotAnswers& to, std::size_t num_poses);
  /// Writes a configuration, whose links have the poses X_WL, as number i of all.
  void reduce(const Robot::Data& robot, const RobotPlaces& places, std::size_t configuration,
              const Pose& X_WB, const Pose* X_WL, std::size_t i, const RobotAnswers& to) const;
};

/// Returns the tools of a robot's links.
inline std::vector<const Tool*> tools_of(const Robot& robot) {
  std::vector<const Tool*> tools;
  for (std::size_t l = 0; l < robot.links().size(); ++l) tools.push_back(&robot.tool(l));
  return tools;
}

/// Makes a RobotContact of a contact of its tools.
struct RobotContactMaker {
  static RobotContact make(const Robot& robot, SceneContact contact, const Place& place,
                           int num_threads);
};

struct RobotContact::Impl {
  Impl(Robot whole, SceneContact made, const Place& place, int num_threads)
      : robot(std::move(whole)),
        contact(std::move(made)),
        is_on_gpu(place.backend == Backend::cuda),
        pool(std::make_unique<ThreadPool>(num_threads)) {}

  const Robot::Data& data() const { return robot.data(); }
  Status check(const RobotPoses& poses) const;
  /// Measures where the links are placed, too: joint_tree.h.
  Status measure_on_gpu(const Scene& scene, const RobotPoses& poses, const TreeAnswers& to) const;
  std::size_t place(const RobotPoses& poses, std::size_t first);
  ScenePoses scene_poses(std::size_t num, bool has_groups) const;

  const Robot robot;
  SceneContact contact;
  const bool is_on_gpu;
  std::unique_ptr<ThreadPool> pool;
  RobotPlaces places;      // of some configurations, as all that follows
  std::vector<Pose> X_WL;  // of each limb
  std::vector<std::int32_t> tool_of_pose, group_of_pose;
};

}}  // namespace palpate::v0
