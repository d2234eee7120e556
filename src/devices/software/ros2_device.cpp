#include "src/devices/software/ros2_device.h"

#include <algorithm>
#include <atomic>
#include <charconv>
#include <chrono>
#include <cmath>
#include <memory>
#include <mutex>
#include <thread>
#include <utility>

#include "src/core/internal/monotonic_clock.h"
#include "src/core/internal/triple_buffer.h"
#include "src/devices/device_kinds.h"
#include "src/devices/internal/polling_device.h"
#include "src/devices/internal/twist_between.h"
#include "src/ros/internal/dds_api.h"
#include "src/ros/internal/ros_node.h"
#include "src/ros/internal/tf_tree.h"

namespace palpate { inline namespace v0 {
namespace {

constexpr double kFirstPose = 10;         // s, at the start
constexpr double kVelocityFilter = 0.02;  // s, of velocities from positions
constexpr double kShortestStep = 1e-4;    // s between poses that a velocity comes from

/// Received pose; times: s, monotonic. With tf it has several parts, which come one by one.
struct ReceivedPose {
  Pose X_BH;
  double oldest = 0;  // arrival of the part that has not come again for longest
  double newest = 0;  // when the pose changed
};

class Ros2Tool final : public PolledDevice {
 public:
  Ros2Tool(Ros2ToolAddress address, std::string name) : address_(std::move(address)) {
    info_.kind = "ros2";
    info_.name = std::move(name);
    info_.limits = input_only_limits();
  }
  ~Ros2Tool() override { end(); }

  Status begin() override {
    end();
    auto node = RosNode::join();
    if (!node) return node.error();
    node_ = *std::move(node);
    if (const Status status = listen(); !status) return status.error();
    const double start = monotonic_now();
    while (num_poses_ == 0) {
      if (monotonic_now() - start > kFirstPose) {
        const Error error{Errc::unavailable, info_.name + ": " + what_is_missing()};
        end();
        return error;
      }
      std::this_thread::sleep_for(std::chrono::milliseconds(5));
    }
    last_ = {};
    V_BH_ = {};
    return Done{};
  }

  bool read(DeviceState& state) noexcept override {
    if (poses_.refresh()) take(poses_.value());
    state.is_valid = last_.newest > 0 && state.time - last_.oldest <= address_.max_age;
    state.X_BH = last_.X_BH;
    state.V_BH = state.is_valid ? V_BH_ : Twist{};
    return true;  // a robot that is silent may come back
  }
  bool write(const Wrench&) noexcept override { return true; }
  void end() noexcept override {
    pose_.reset();
    transforms_.reset();
    statics_.reset();
    num_poses_ = 0;
    tree_.clear();
  }

 private:
  Status listen() {
    const auto join = [&](const char* topic, bool is_static,
                          std::unique_ptr<RosSubscription>& to) -> Status {
      const RosQos qos{.is_reliable = true, .is_kept = is_static, .depth = 100};
      auto subscription = node_->subscribe(
          topic, "tf2_msgs/TFMessage", qos,
          [this, is_static](std::string_view message) { add_transforms(message, is_static); });
      if (!subscription) return subscription.error();
      to = *std::move(subscription);
      return Done{};
    };
    if (address_.topic.empty() || !address_.base.empty()) {
      if (const Status moving = join("/tf", false, transforms_); !moving) return moving;
      if (const Status fixed = join("/tf_static", true, statics_); !fixed) return fixed;
    }
    if (address_.topic.empty()) return Done{};
    auto poses = node_->subscribe(address_.topic, "geometry_msgs/PoseStamped", RosQos::sensor(),
                                  [this](std::string_view message) { follow_pose(message); });
    if (!poses) return poses.error();
    pose_ = *std::move(poses);
    return Done{};
  }

  // Threads of the subscriptions.

  void add_transforms(std::string_view message, bool is_static) {
    const auto transforms = read_transforms(message);
    if (!transforms) return;
    for (const RosStampedTransform& each : *transforms) {
      tree_.add(each, is_static, arrival_of(each.time));
    }
    if (address_.topic.empty()) follow_frame();
  }
  /// Updates the pose from tf. Messages about other frames leave the pose as old as it was.
  void follow_frame() {
    const auto found = tree_.find(address_.base, address_.frame);
    if (!found) return;
    const bool is_fixed = std::isinf(found->oldest);
    tell({found->X_AB, found->oldest, is_fixed ? monotonic_now() : found->newest});
  }
  void follow_pose(std::string_view message) {
    const auto pose = read_pose(message);
    if (!pose) return;
    const double time = arrival_of(pose->time);
    if (address_.base.empty() || pose->frame.empty() || pose->frame == address_.base) {
      tell({pose->pose, time, time});
    } else if (const auto found = tree_.find(address_.base, pose->frame)) {
      tell({found->X_AB * pose->pose, std::min(time, found->oldest), time});
    }
  }
  /// Arrival of a message with this stamp, or its stamp if clocks are shared; s, monotonic.
  double arrival_of(double stamp) const {
    const double now = monotonic_now();
    if (!address_.has_our_clock) return now;
    const auto wall = std::chrono::system_clock::now().time_since_epoch();
    return std::min(now, now + stamp - std::chrono::duration<double>(wall).count());
  }
  void tell(const ReceivedPose& pose) {
    const std::lock_guard lock(mutex_);
    poses_.publish(pose);
    ++num_poses_;
  }

  std::string what_is_missing() const {
    const std::string seconds = " within 10 s";
    if (!address_.topic.empty()) {
      return "no pose has come" + seconds +
             (pose_->num_writers() == 0 ? "; there is no publisher of " + address_.topic
              : address_.base.empty()   ? ""
                                        : "; is its frame joined to " + address_.base + " by tf?");
    }
    return "tf joins no " + address_.frame + " to " + address_.base + seconds +
           (transforms_->num_writers() + statics_->num_writers() == 0
                ? "; there is no publisher of /tf"
                : "");
  }

  /// Takes the newest pose; called by the ticking thread.
  void take(const ReceivedPose& pose) noexcept {
    const double seconds = pose.newest - last_.newest;
    if (last_.newest > 0 && seconds > kShortestStep) {
      const bool goes_on = seconds < address_.max_age;
      const Twist now = goes_on ? twist_between(last_.X_BH, pose.X_BH, seconds) : Twist{};
      const double share = 1 - std::exp(-seconds / kVelocityFilter);
      V_BH_.linear += share * (now.linear - V_BH_.linear);
      V_BH_.angular += share * (now.angular - V_BH_.angular);
    }
    last_ = pose;
  }

  const Ros2ToolAddress address_;
  std::shared_ptr<RosNode> node_;
  TfTree tree_;
  std::mutex mutex_;  // guards the members that subscriptions write
  TripleBuffer<ReceivedPose> poses_;
  std::atomic<std::uint64_t> num_poses_ = 0;
  ReceivedPose last_;
  Twist V_BH_;
  std::unique_ptr<RosSubscription> pose_, transforms_, statics_;  // last: they use the others
};

/// Returns the text before the first `mark`; `rest` keeps the text after it.
std::string_view take_until(std::string_view& rest, char mark) {
  const std::size_t at = std::min(rest.find(mark), rest.size());
  const std::string_view part = rest.substr(0, at);
  rest.remove_prefix(std::min(at + 1, rest.size()));
  return part;
}

/// Returns an age, s; 0 if the text is not a number from 0.001 to 10.
double max_age_of(std::string_view text) {
  double seconds = 0;
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), seconds);
  const bool is_number = error == std::errc() && end == text.data() + text.size();
  return is_number && seconds >= 0.001 && seconds <= 10 ? seconds : 0;
}

}  // namespace

Result<Ros2ToolAddress> parse_ros2_tool(std::string_view address) {
  std::string_view rest = address;
  std::string_view frames = take_until(rest, '?');
  Ros2ToolAddress tool;
  const std::string what(take_until(frames, '@'));
  tool.base = frames;
  if (what.starts_with('/') && what.size() > 1) {
    tool.topic = what;
  } else if (!what.empty() && !tool.base.empty()) {
    tool.frame = what;
  } else {
    return Error{Errc::invalid_argument,
                 "ros2:" + std::string(address) +
                     " names no tool; write ros2:/POSE_TOPIC[@CAMERA_FRAME] or "
                     "ros2:TOOL_FRAME@CAMERA_FRAME, e.g. ros2:tool0@camera_depth_optical_frame"};
  }
  while (!rest.empty()) {
    const std::string_view one = take_until(rest, '&');
    std::string_view value = one;
    const std::string_view name = take_until(value, '=');
    const double max_age = name == "max_age" ? max_age_of(value) : 0;
    if (max_age > 0) {
      tool.max_age = max_age;
    } else if (one == "clock=own" || one == "clock=shared") {
      tool.has_our_clock = value == "shared";
    } else {
      return Error{Errc::invalid_argument,
                   "ros2:" + std::string(address) + ": '" + std::string(one.substr(0, 40)) +
                       "' is not known; there are max_age=S, from 0.001 to 10 s, and "
                       "clock=own|shared"};
    }
  }
  return tool;
}

Result<std::unique_ptr<HapticDevice>> open_ros2_device(std::string_view address) {
  auto parsed = parse_ros2_tool(address);
  if (!parsed) return parsed.error();
  if (const auto& api = dds::api(); !api) return api.error();
  const std::string name = "ros2:" + std::string(address.substr(0, address.find('?')));
  return std::unique_ptr<HapticDevice>(
      std::make_unique<PollingDevice>(std::make_unique<Ros2Tool>(*std::move(parsed), name)));
}

FoundDevice find_ros2_device() {
  const auto& api = dds::api();
  if (!api)
    return {"ros2:/POSE_TOPIC", "ros2", false, api.error().message,
            "a tool that a robot holds needs Cyclone DDS"};
  return {"ros2:/POSE_TOPIC", "ros2", true,
          "a tool that a robot holds, by " + api->path +
              "; ros2:TOOL_FRAME@CAMERA_FRAME for one by tf; without forces",
          ""};
}

}}  // namespace palpate::v0
