#include "src/cameras/internal/robot_states.h"

#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <limits>
#include <utility>

#include "palpate/cameras/cameras.h"
#include "src/core/internal/message_text.h"
#include "src/core/internal/monotonic_clock.h"
#include "src/io/internal/atomic_file.h"
#include "src/io/internal/bag_file.h"
#include "src/io/internal/ros_messages.h"
#include "src/ros/internal/ros_node.h"

namespace palpate { inline namespace v0 {
namespace {

constexpr double kSecondsKept = 5;                  // live, of each joint and frame
constexpr double kLongestWait = 1;                  // s
constexpr std::size_t kMaxJointNumbers = 20000000;  // numbers in a file
constexpr double kForEver = std::numeric_limits<double>::infinity();

double kept_of(const StateAddress& address) {
  return address.kind == StateAddress::Kind::ros2 ? kSecondsKept : kForEver;
}

/// Explanation for stamps that cannot be of one clock; `until`: s, the newest stamp.
std::string clock_hint(bool is_by_stamp, double time, double until) {
  constexpr double kFarAway = 60;  // s
  if (!is_by_stamp || std::isinf(until) || std::abs(time - until) < kFarAway) return "";
  return "; images and robot are stamped by different clocks: give both one, or say match=arrival";
}

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
    } else if (!is_bag && (one == "match=stamps" || one == "match=arrival")) {
      address.goes_by_arrival = one == "match=arrival";
    } else {
      return Error{Errc::invalid_argument,
                   "joints " + address.text.substr(0, 60) + ": '" + std::string(one.substr(0, 40)) +
                       "' is not known; there are " +
                       (is_bag ? "topic=/TOPIC" : "match=stamps|arrival") + " and world=FRAME"};
    }
  }
  return address;
}

RobotStates::RobotStates(StateAddress address, std::vector<JointHistory::Joint> joints)
    : address_(std::move(address)),
      num_joints_(joints.size()),
      by_time_{JointHistory(joints, kept_of(address_)), TfHistory(kept_of(address_))},
      by_stamp_{JointHistory(std::move(joints), kSecondsKept), TfHistory(kSecondsKept)},
      may_go_by_stamps_(address_.kind == StateAddress::Kind::ros2 && !address_.goes_by_arrival) {}

bool RobotStates::goes_by_stamps() const {
  return may_go_by_stamps_ && monotonic_now() - unstamped_at_ > kSecondsKept;
}

bool RobotStates::counts_by_stamp(bool has_stamp) {
  if (may_go_by_stamps_ && !has_stamp) unstamped_at_ = monotonic_now();
  return may_go_by_stamps_ && has_stamp;
}

template <class KnownUntil>
std::pair<const RobotStates::Histories&, double> RobotStates::states_at(
    std::unique_lock<std::mutex>& lock, const Moment& moment, const KnownUntil& known_until) const {
  const auto found = [&]() -> std::pair<const Histories&, double> {
    if (moment.stamp != 0 && goes_by_stamps()) return {by_stamp_, moment.stamp};
    return {by_time_, moment.time};
  };
  if (!is_live() || !moment.waits) return found();
  const std::chrono::duration<double> longest(std::min(moment.max_age, kLongestWait));
  changed_.wait_for(lock, longest, [&] {
    const auto [what, time] = found();
    const double until = known_until(what, time);
    // A source that has been silent for long is not waited for with every image.
    return until >= time || until < time - moment.max_age;
  });
  return found();
}

Status RobotStates::positions(const Moment& moment, std::vector<double>& positions) const {
  // A table of one line is a robot that stands still; a recording in which a joint falls silent is
  // not.
  const bool may_stay = address_.kind == StateAddress::Kind::table;
  positions.resize(num_joints_);
  std::unique_lock lock(mutex_);
  const auto [states, time] = states_at(
      lock, moment, [](const Histories& what, double) { return what.joints.known_until(); });
  for (std::size_t i = 0; i < num_joints_; ++i) {
    const auto position = states.joints.at(i, time, moment.max_age, may_stay);
    if (position) {
      positions[i] = *position;
      continue;
    }
    return Error{position.error().code,
                 position.error().message +
                     clock_hint(&states == &by_stamp_, time, states.joints.known_until())};
  }
  return Done{};
}

Status RobotStates::links_in_world(std::span<const std::string> links, const Moment& moment,
                                   std::span<Pose> X_WL) const {
  std::unique_lock lock(mutex_);
  const auto [states, time] = states_at(lock, moment, [&](const Histories& what, double at) {
    double until = kForEver;
    for (const std::string& link : links) {
      until = std::min(until, what.transforms.known_until(address_.world, link, at));
    }
    return until;
  });
  for (std::size_t i = 0; i < links.size(); ++i) {
    const auto X = states.transforms.find(address_.world, links[i], time, moment.max_age);
    if (X) {
      X_WL[i] = *X;
      continue;
    }
    const double until = states.transforms.known_until(address_.world, links[i], time);
    std::string why = "tf has no transform for '" + shown(links[i]) + "'";
    if (until < time && until > -kForEver) {
      char text[80];
      std::snprintf(text, sizeof text, " later than %.3g s before the image", time - until);
      why += text;
    }
    return Error{Errc::unavailable, why + clock_hint(&states == &by_stamp_, time, until)};
  }
  return Done{};
}

std::string RobotStates::missing_joints() const {
  const std::lock_guard lock(mutex_);
  return by_time_.joints.missing();
}

std::string RobotStates::missing_links(const std::vector<std::string>& links) const {
  const std::lock_guard lock(mutex_);
  std::string names;
  for (const std::string& link : links) {
    if (by_time_.transforms.are_joined(address_.world, link)) continue;
    names += (names.empty() ? "" : ", ") + shown(link);
  }
  return names;
}

void RobotStates::add_joint_message(std::string_view message) {
  const auto state = read_joint_state(message);
  if (!state || state->names.empty()) return;
  const std::lock_guard lock(mutex_);
  const double time = time_of(state->time, state->names.front());
  const bool is_by_stamp = counts_by_stamp(state->time != 0);
  for (std::size_t i = 0; i < state->names.size(); ++i) {
    by_time_.joints.add(state->names[i], time, state->positions[i]);
    if (is_by_stamp) by_stamp_.joints.add(state->names[i], state->time, state->positions[i]);
  }
  changed_.notify_all();
}

void RobotStates::add_transform_message(std::string_view message, bool is_static) {
  const auto transforms = read_transforms(message);
  if (!transforms) return;
  const std::lock_guard lock(mutex_);
  for (RosStampedTransform each : *transforms) {
    if (counts_by_stamp(is_static || each.time != 0)) by_stamp_.transforms.add(each, is_static);
    if (!is_static) each.time = time_of(each.time, each.child);
    by_time_.transforms.add(each, is_static);
  }
  changed_.notify_all();
}

namespace {

class TableStates final : public RobotStates {
 public:
  using RobotStates::RobotStates;
  Status read() {
    const auto text = read_file(address_.target, kMaxJointNumbers * 8);
    if (!text) return text.error();
    return read_joint_table(*text, address_.target, by_time_.joints);
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
      if (!*message) break;
      const McapChannel& channel = (*reader)->channels().at((*message)->channel);
      recorded_ = 1e-9 * static_cast<double>((*message)->time);
      if (channel.schema_name == "tf2_msgs/msg/TFMessage" && !address_.world.empty()) {
        add_transform_message((*message)->data, channel.topic.ends_with("static"));
      } else if (channel.schema_name == "sensor_msgs/msg/JointState" &&
                 (address_.topic.empty() || channel.topic == address_.topic)) {
        add_joint_message((*message)->data);
      }
    }
    const std::string impossible = by_time_.joints.impossible();
    if (impossible.empty()) return Done{};
    return Error{Errc::bad_input, address_.target + ": " + impossible +
                                      ", where no joint is: record it again, or leave it out"};
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
      // Deep enough for everything that comes while this computer is busy.
      const RosQos sensor{.is_reliable = false, .is_kept = false, .depth = 100};
      return join(topic, "sensor_msgs/JointState", sensor,
                  [this](std::string_view message) { add_joint_message(message); });
    }
    const RosQos moving{.is_reliable = true, .is_kept = false, .depth = 100},
        fixed{.is_reliable = true, .is_kept = true, .depth = 100};
    const Status handler =
        join("/tf", "tf2_msgs/TFMessage", moving,
             [this](std::string_view message) { add_transform_message(message, false); });
    if (!handler) return handler;
    return join("/tf_static", "tf2_msgs/TFMessage", fixed,
                [this](std::string_view message) { add_transform_message(message, true); });
  }

 private:
  Status join(const std::string& topic, const std::string& type, const RosQos& qos,
              RosNode::MessageHandler handler) {
    auto subscription = node_->subscribe(topic, type, qos, std::move(handler));
    if (!subscription) return subscription.error();
    subscriptions_.push_back(*std::move(subscription));
    return Done{};
  }
  double time_of(double stamp, const std::string& who) override {
    constexpr std::size_t kMaxClocks = 1000;
    if (stamp == 0) return monotonic_now();  // it has none
    const std::string& clock = clocks_.size() < kMaxClocks || clocks_.contains(who) ? who : "";
    return clocks_[clock].add(stamp, monotonic_now());
  }

  std::shared_ptr<RosNode> node_;
  std::map<std::string, CaptureClock> clocks_;
  std::vector<std::unique_ptr<RosSubscription>>
      subscriptions_;  // last: their threads use the members above
};

template <class States>
Result<std::unique_ptr<RobotStates>> opened(std::unique_ptr<States> states, const Status& status) {
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

}}  // namespace palpate::v0
