#include "src/cameras/internal/link_in_tree.h"

#include <filesystem>
#include <system_error>
#include <utility>
#include <vector>

#include "src/core/internal/message_text.h"
#include "src/io/internal/atomic_file.h"

namespace palpate { inline namespace v0 {
namespace {

constexpr std::size_t kMaxBytes = 64u << 20;  // of a URDF
constexpr double kMaxAge = 0.1;               // s, of a joint position

/// Joints whose states are needed. Errors: as of open_joint_states, from the URDF alone.
Result<std::vector<JointHistory::Joint>> desired_joints(const RobotModel& model,
                                                        std::span<const std::size_t> required,
                                                        const std::string& joints,
                                                        const std::string& robot) {
  const auto address = parse_state_address(joints);
  if (!address) return address.error();
  std::vector<JointHistory::Joint> desired;
  std::string all;
  for (const std::size_t i : required) {
    const RobotJoint& joint = model.joints[i];
    if (joint.kind == RobotJoint::Kind::floating) {
      return Error{Errc::bad_input, robot + ": joint '" + shown(joint.name) +
                                        "' is floating or planar: a joint position does not place "
                                        "it; use the frames of tf (world=FRAME)"};
    }
    desired.push_back({joint.name, joint.is_endless});
    all += (all.empty() ? "" : ", ") + shown(joint.name);
  }
  if (desired.empty() && !joints.empty()) {
    return Error{Errc::invalid_argument,
                 robot + " has no joints that move: leave out " + address->text};
  }
  if (!desired.empty() && joints.empty()) {
    return Error{Errc::invalid_argument,
                 robot + " has joints that move: " + all +
                     "; pass a source of joint states (--joints FILE.csv, bag:FILE or ros2:)"};
  }
  return desired;
}

}  // namespace

Result<std::unique_ptr<RobotStates>> open_joint_states(const RobotModel& model,
                                                       std::span<const std::size_t> required,
                                                       const std::string& joints,
                                                       const std::string& robot) {
  auto desired = desired_joints(model, required, joints, robot);
  if (!desired) return desired.error();
  if (desired->empty()) return std::unique_ptr<RobotStates>();
  const auto address = parse_state_address(joints);
  if (!address) return address.error();
  auto states = RobotStates::open(*address, *std::move(desired));
  if (!states) return states.error();
  const std::string missing =
      what_is_missing(**states, [&] { return (*states)->missing_joints(); });
  if (!missing.empty()) {
    return Error{Errc::bad_input,
                 address->text + " has no states for joints of " + robot + ": " + missing};
  }
  return states;
}

std::size_t end_of_file(const std::string& address) {
  constexpr std::size_t kLongestPath = 4096;  // of Linux
  const std::size_t first = address.find('#');
  for (std::size_t at = first; at < kLongestPath; at = address.find('#', at + 1)) {
    std::error_code ignored;
    if (std::filesystem::is_regular_file(address.substr(0, at), ignored)) return at;
  }
  return first;
}

Result<LinkInTree> LinkInTree::open(const std::string& address, const std::string& joints,
                                    bool is_received, RobotTrees& trees) {
  const std::size_t first = end_of_file(address), second = address.find('#', first + 1);
  const std::string file = address.substr(0, first);
  if (first == std::string::npos || first == 0) {
    return Error{Errc::invalid_argument, "give FILE.urdf#LINK, the link that is meant, not '" +
                                             address.substr(0, 60) + "'"};
  }
  const auto model = trees.get(file, [&](const std::filesystem::path&) -> Result<RobotModel> {
    const auto text = read_file(file, kMaxBytes);
    if (!text) return text.error();
    return parse_urdf(*text, file, {}, std::nullopt);
  });
  if (!model) return model.error();
  LinkInTree found;
  found.model_ = *model;
  found.base_ = found.model_->root;
  const auto find = [&](const std::string& name, std::size_t& link) -> Status {
    const auto number = found.model_->find_link(name);
    if (!number) return Error{number.error().code, file + ": " + number.error().message};
    link = *number;
    return Done{};
  };
  const std::size_t length = second == std::string::npos ? second : second - first - 1;
  Status status = find(address.substr(first + 1, length), found.link_);
  if (status && second != std::string::npos) status = find(address.substr(second + 1), found.base_);
  if (!status) return status.error();
  found.required_ = found.model_->joints_between(found.base_, found.link_);
  if (!is_received) {
    const auto desired = desired_joints(*found.model_, found.required_, joints, file);
    if (!desired) return desired.error();
    return found;
  }
  auto states = open_joint_states(*found.model_, found.required_, joints, file);
  if (!states) return states.error();
  found.states_ = *std::move(states);
  return found;
}

Result<Pose> LinkInTree::at(double time, double stamp) const {
  std::vector<double> values, positions(model_->joints.size());
  if (states_) {
    if (const Status status = states_->positions({time, stamp, kMaxAge}, values); !status) {
      return status.error();
    }
    for (std::size_t i = 0; i < required_.size(); ++i) positions[required_[i]] = values[i];
  }
  std::vector<Pose> X_RL(model_->links.size());  // in the root
  model_->place(positions, X_RL);
  return inverse(X_RL[base_]) * X_RL[link_];
}

}}  // namespace palpate::v0
