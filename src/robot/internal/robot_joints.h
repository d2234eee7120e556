// A robot's joints as they are reported: where its links are, for the self filter and for questions
// about now.
#pragma once

#include <memory>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "palpate/robot/robot.h"
#include "src/cameras/internal/robot_states.h"

namespace palpate { inline namespace v0 {

class RobotJoints final : public LinkPoses {
 public:
  /// `source`: as RobotFiles::joints, without tf. Live, waits for a state of each joint that moves
  /// a link with spheres; other joints are not looked at. `max_age`, s, of states. Errors: no such
  /// source; a joint without states, with its name.
  static Result<std::shared_ptr<const RobotJoints>> open(const Robot& robot,
                                                         const std::string& source,
                                                         const Pose& X_WB, double max_age);

  /// Places the links of Robot::links.
  Status at(double time, std::span<Pose> X_WL) const override;
  Status at_frame(const DepthFrame& frame, std::span<Pose> X_WL) const override;
  std::optional<bool> is_live() const override;

  /// Positions of Robot::joints at a time, s, as far as they are known by now: extrapolated from
  /// the newest reports. Does not wait. Error: a joint without a report within `max_age`.
  Result<std::vector<double>> known_at(double time) const;

 private:
  RobotJoints(const Robot& robot, const Pose& X_WB, double max_age)
      : robot_(robot), X_WB_(X_WB), max_age_(max_age) {}
  Result<std::vector<double>> positions(const RobotStates::Moment& moment) const;
  Status place(const RobotStates::Moment& moment, std::span<Pose> X_WL) const;

  const Robot robot_;
  const Pose X_WB_;
  const double max_age_;
  std::vector<std::size_t> required_;    // of Robot::joints
  std::unique_ptr<RobotStates> states_;  // null: nothing moves
};

}}  // namespace palpate::v0
