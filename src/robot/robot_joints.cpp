#include "src/robot/internal/robot_joints.h"

#include <set>
#include <utility>

#include "src/cameras/internal/link_in_tree.h"
#include "src/robot/robot_data.h"

namespace palpate { inline namespace v0 {

Result<std::shared_ptr<const RobotJoints>> RobotJoints::open(const Robot& robot,
                                                             const std::string& source,
                                                             const Pose& X_WB, double max_age) {
  const Robot::Data& data = robot.data();
  std::set<std::size_t> required;
  for (const RobotLimb& limb : data.limbs) {
    for (const RobotLimb::Mover& mover : limb.movers) required.insert(mover.moved);
  }
  auto made = std::shared_ptr<RobotJoints>(new RobotJoints(robot, X_WB, max_age));
  made->required_.assign(required.begin(), required.end());
  std::vector<std::size_t> in_model;
  for (const std::size_t joint : required) in_model.push_back(data.moved[joint]);
  auto states = open_joint_states(data.model, in_model, source, robot.name());
  if (!states) return states.error();
  made->states_ = *std::move(states);
  return std::shared_ptr<const RobotJoints>(std::move(made));
}

Result<std::vector<double>> RobotJoints::positions(const RobotStates::Moment& moment) const {
  std::vector<double> joints(robot_.joints().size()), reported;
  if (states_ == nullptr) return joints;
  if (const Status status = states_->positions(moment, reported); !status) return status.error();
  for (std::size_t i = 0; i < required_.size(); ++i) joints[required_[i]] = reported[i];
  return joints;
}

Status RobotJoints::place(const RobotStates::Moment& moment, std::span<Pose> X_WL) const {
  const auto joints = positions(moment);
  if (!joints) return joints.error();
  return robot_.place(*joints, X_WB_, X_WL);
}

Status RobotJoints::at(double time, std::span<Pose> X_WL) const {
  return place({time, 0, max_age_}, X_WL);
}

Status RobotJoints::at_frame(const DepthFrame& frame, std::span<Pose> X_WL) const {
  return place({frame.timestamp, frame.stamp, max_age_}, X_WL);
}

std::optional<bool> RobotJoints::is_live() const {
  return states_ ? std::optional(states_->is_live()) : std::nullopt;
}

Result<std::vector<double>> RobotJoints::known_at(double time) const {
  return positions({time, 0, max_age_, false});
}

}}  // namespace palpate::v0
