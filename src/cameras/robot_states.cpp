#include "src/cameras/robot_states.h"

#include <utility>

#include "palpate/cameras/cameras.h"
#include "src/core/monotonic_clock.h"
#include "src/io/internal/atomic_file.h"
#include "src/io/internal/bag_file.h"
#include "src/io/ros_messages.h"
#include "src/ros/ros_node.h"

namespace palpate {
namespace {

constexpr std::size_t kNumKept = 4096;       // live, of each joint: 4 s at 1 kHz
constexpr double kSecondsKept = 5;           // live, of each frame
constexpr std::size_t kMostTold = 20000000;  // numbers in a file
constexpr double kForEver = 1e12;            // s

}  // namespace

Result<StateAddress> parse_state_address(std::string_view text) {
  StateAddress address;
  address.text = text;
  address.target = text;
  if (!text.starts_with("bag:") && !text.starts_with("ros2:")) return address;
  address.kind = text.starts_with("bag:") ? StateAddress::Kind::bag : StateAddress::Kind::ros2;
  const std::size_t parameters = text.find('?');
  address.target = text.substr(text.find(':') + 1, parameters == std::string_view::npos
                                                       ? std::string_view::npos
                                                       : parameters - text.find(':') - 1);
  std::string_view rest =
      parameters == std::string_view::npos ? std::string_view() : text.substr(parameters + 1);
  while (!rest.empty()) {
    const std::string_view one = rest.substr(0, rest.find('&'));
    rest.remove_prefix(std::min(rest.size(), one.size() + 1));
    const bool is_bag = address.kind == StateAddress::Kind::bag;
    if (one.starts_with("world=") && one.size() > 6) {
      address.world = one.substr(6);
    } else if (is_bag && one.starts_with("topic=") && one.size() > 6) {
      address.topic = one.substr(6);
    } else {
      return Error{Errc::invalid_argument, "joints " + address.text.substr(0, 60) + ": '" +
                                               std::string(one.substr(0, 40)) +
                                               "' is not known; there are " +
                                               (is_bag ? "topic=/TOPIC and " : "") + "world=FRAME"};
    }
  }
  return address;
}

RobotStates::RobotStates(StateAddress address, std::vector<JointHistory::Joint> joints)
    : address_(std::move(address)),
      num_joints_(joints.size()),
      joints_(std::move(joints)),
      transforms_(address_.kind == StateAddress::Kind::ros2 ? kSecondsKept : kForEver) {}

Status RobotStates::positions(double time, double max_age, std::vector<double>& positions) const {
  // A robot that stands still is written as one line; a recording in which a joint falls silent is
  // none.
  const bool may_stay = address_.kind == StateAddress::Kind::table;
  positions.resize(num_joints_);
  const std::lock_guard lock(mutex_);
  for (std::size_t i = 0; i < num_joints_; ++i) {
    const auto position = joints_.at(i, time, max_age, may_stay);
    if (!position) return position.error();
    positions[i] = *position;
  }
  return Done{};
}

std::optional<Pose> RobotStates::link_in_world(const std::string& link, double time,
                                               double max_age) const {
  const std::lock_guard lock(mutex_);
  return transforms_.find(address_.world, link, time, max_age);
}

std::string RobotStates::missing_joints() const {
  const std::lock_guard lock(mutex_);
  return joints_.missing();
}

std::string RobotStates::missing_links(const std::vector<std::string>& links) const {
  const std::lock_guard lock(mutex_);
  std::string names;
  for (const std::string& link : links) {
    if (transforms_.find(address_.world, link, 0, kForEver)) continue;
    names += (names.empty() ? "" : ", ") + link;
  }
  return names;
}

void RobotStates::hear_joints(std::string_view message) {
  const auto state = read_joint_state(message);
  if (!state || state->names.empty()) return;
  const std::lock_guard lock(mutex_);
  const double time = time_of(state->time, state->names.front());
  for (std::size_t i = 0; i < state->names.size(); ++i) {
    joints_.add(state->names[i], time, state->positions[i]);
  }
  if (is_live()) joints_.keep_newest(kNumKept);
}

void RobotStates::hear_transforms(std::string_view message, bool is_static) {
  const auto transforms = read_transforms(message);
  if (!transforms) return;
  const std::lock_guard lock(mutex_);
  for (RosStampedTransform each : *transforms) {
    if (!is_static) each.time = time_of(each.time, each.child);
    transforms_.add(each, is_static);
  }
}

namespace {

class TableStates final : public RobotStates {
 public:
  using RobotStates::RobotStates;
  Status read() {
    const auto text = read_file(address_.target, kMostTold * 8);
    if (!text) return text.error();
    return read_joint_table(*text, address_.target, joints_);
  }
};

class BagStates final : public RobotStates {
 public:
  using RobotStates::RobotStates;
  Status read() {
    auto reader = BagReader::open(address_.target);
    if (!reader) return reader.error();
    for (;;) {
      const auto message = (*reader)->next();
      if (!message) return message.error();
      if (!*message) return Done{};
      const McapChannel& channel = (*reader)->channels().at((*message)->channel);
      recorded_ = 1e-9 * static_cast<double>((*message)->time);
      if (channel.schema_name == "tf2_msgs/msg/TFMessage" && !address_.world.empty()) {
        hear_transforms((*message)->data, channel.topic.ends_with("static"));
      } else if (channel.schema_name == "sensor_msgs/msg/JointState" &&
                 (address_.topic.empty() || channel.topic == address_.topic)) {
        hear_joints((*message)->data);
      }
    }
  }

 private:
  /// Messages that do not say when they were made count from when they were recorded.
  double time_of(double stamp, const std::string&) override {
    return stamp == 0 ? recorded_ : stamp;
  }
  double recorded_ = 0;
};

class LiveStates final : public RobotStates {
 public:
  using RobotStates::RobotStates;
  bool is_live() const override { return true; }

  Status listen() {
    auto node = RosNode::join();
    if (!node) return node.error();
    node_ = *std::move(node);
    if (address_.world.empty()) {
      const std::string topic = address_.target.empty() ? "/joint_states" : address_.target;
      return join(topic, "sensor_msgs/JointState", RosQos::sensor(),
                  [this](std::string_view message) { hear_joints(message); });
    }
    const RosQos moving{.is_reliable = true, .is_kept = false, .depth = 100},
        fixed{.is_reliable = true, .is_kept = true, .depth = 100};
    const Status heard =
        join("/tf", "tf2_msgs/TFMessage", moving,
             [this](std::string_view message) { hear_transforms(message, false); });
    if (!heard) return heard;
    return join("/tf_static", "tf2_msgs/TFMessage", fixed,
                [this](std::string_view message) { hear_transforms(message, true); });
  }

 private:
  Status join(const std::string& topic, const std::string& type, const RosQos& qos,
              RosNode::Heard heard) {
    auto subscription = node_->subscribe(topic, type, qos, std::move(heard));
    if (!subscription) return subscription.error();
    subscriptions_.push_back(*std::move(subscription));
    return Done{};
  }
  double time_of(double stamp, const std::string& who) override {
    constexpr std::size_t kMostClocks = 1000;
    if (stamp == 0) return monotonic_now();  // it has none
    const std::string& clock = clocks_.size() < kMostClocks || clocks_.contains(who) ? who : "";
    return clocks_[clock].add(stamp, monotonic_now());
  }

  std::shared_ptr<RosNode> node_;
  std::map<std::string, CaptureClock> clocks_;
  std::vector<std::unique_ptr<RosSubscription>>
      subscriptions_;  // last: they speak to what is above
};

template <class States>
Result<std::unique_ptr<RobotStates>> opened(std::unique_ptr<States> states, Status status) {
  if (!status) return status.error();
  return std::unique_ptr<RobotStates>(std::move(states));
}

}  // namespace

Result<std::unique_ptr<RobotStates>> RobotStates::open(const StateAddress& address,
                                                       std::vector<JointHistory::Joint> joints) {
  if (address.kind == StateAddress::Kind::ros2) {
    auto states = std::make_unique<LiveStates>(address, std::move(joints));
    const Status status = states->listen();
    return opened(std::move(states), status);
  }
  if (address.kind == StateAddress::Kind::bag) {
    auto states = std::make_unique<BagStates>(address, std::move(joints));
    const Status status = states->read();
    return opened(std::move(states), status);
  }
  auto states = std::make_unique<TableStates>(address, std::move(joints));
  const Status status = states->read();
  return opened(std::move(states), status);
}

}  // namespace palpate
