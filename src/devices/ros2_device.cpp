#include "src/devices/ros2_device.h"

#include <atomic>
#include <cmath>
#include <memory>
#include <mutex>
#include <thread>
#include <utility>

#include "src/core/internal/triple_buffer.h"
#include "src/core/monotonic_clock.h"
#include "src/devices/device_kinds.h"
#include "src/devices/input_only.h"
#include "src/devices/polling_device.h"
#include "src/devices/twist_between.h"
#include "src/ros/dds_api.h"
#include "src/ros/ros_node.h"
#include "src/ros/tf_tree.h"

namespace palpate::inline v0 {
namespace {

constexpr double kFirstPose = 10;         // s, at the start
constexpr double kMaxAge = 0.1;           // s: a pose is taken for present until then
constexpr double kVelocityFilter = 0.02;  // s, of velocities from positions
constexpr double kShortestStep = 1e-4;    // s between poses that a velocity comes from

struct ReceivedPose {
  Pose X_BH;
  double time = 0;  // s, monotonic: when it came
};

class Ros2Tool final : public PolledDevice {
 public:
  Ros2Tool(Ros2ToolAddress address, std::string name) : address_(std::move(address)) {
    info_.kind = "ros2";
    info_.name = std::move(name);
    info_.limits = input_only_limits();
  }
  ~Ros2Tool() override { end(); }

  const DeviceInfo& info() const override { return info_; }

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
    const double age = state.time - last_.time;
    state.is_valid = last_.time > 0 && age <= kMaxAge;
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
  }
  Error trouble() const override { return {}; }

 private:
  Status listen() {
    const auto handler = [this](std::string_view message) {
      const auto transforms = read_transforms(message);
      if (!transforms) return;
      for (const RosStampedTransform& each : *transforms) tree_.add(each);
      if (address_.topic.empty()) follow_frame();
    };
    const auto join = [&](const char* topic, const RosQos& qos,
                          std::unique_ptr<RosSubscription>& to) -> Status {
      auto subscription = node_->subscribe(topic, "tf2_msgs/TFMessage", qos, handler);
      if (!subscription) return subscription.error();
      to = *std::move(subscription);
      return Done{};
    };
    if (address_.topic.empty() || !address_.base.empty()) {
      const Status moving =
          join("/tf", {.is_reliable = true, .is_kept = false, .depth = 100}, transforms_);
      if (!moving) return moving;
      const Status fixed =
          join("/tf_static", {.is_reliable = true, .is_kept = true, .depth = 100}, statics_);
      if (!fixed) return fixed;
    }
    if (address_.topic.empty()) return Done{};
    auto poses = node_->subscribe(address_.topic, "geometry_msgs/PoseStamped", RosQos::sensor(),
                                  [this](std::string_view message) { follow_pose(message); });
    if (!poses) return poses.error();
    pose_ = *std::move(poses);
    return Done{};
  }

  // Threads of the subscriptions.

  void follow_frame() {
    if (const auto found = tree_.find(address_.base, address_.frame)) tell(found->X_AB);
  }
  void follow_pose(std::string_view message) {
    const auto pose = read_pose(message);
    if (!pose) return;
    if (address_.base.empty() || pose->frame.empty() || pose->frame == address_.base) {
      tell(pose->pose);
    } else if (const auto found = tree_.find(address_.base, pose->frame)) {
      tell(found->X_AB * pose->pose);
    }
  }
  void tell(const Pose& X_BH) {
    const std::lock_guard lock(mutex_);
    poses_.publish({X_BH, monotonic_now()});
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

  /// The ticking thread.
  void take(const ReceivedPose& pose) noexcept {
    const double seconds = pose.time - last_.time;
    if (last_.time > 0 && seconds > kShortestStep) {
      const Twist now = seconds < kMaxAge ? twist_between(last_.X_BH, pose.X_BH, seconds) : Twist{};
      const double share = 1 - std::exp(-seconds / kVelocityFilter);
      V_BH_.linear += share * (now.linear - V_BH_.linear);
      V_BH_.angular += share * (now.angular - V_BH_.angular);
    }
    last_ = pose;
  }

  const Ros2ToolAddress address_;
  DeviceInfo info_;
  std::shared_ptr<RosNode> node_;
  TfTree tree_;
  std::mutex mutex_;  // of the subscriptions
  TripleBuffer<ReceivedPose> poses_;
  std::atomic<std::uint64_t> num_poses_ = 0;
  ReceivedPose last_;
  Twist V_BH_;
  std::unique_ptr<RosSubscription> pose_, transforms_, statics_;  // last: they speak to the others
};

}  // namespace

Result<Ros2ToolAddress> parse_ros2_tool(std::string_view address) {
  const std::size_t at = std::min(address.find('@'), address.size());
  const std::string what(address.substr(0, at));
  const std::string base(address.substr(std::min(at + 1, address.size())));
  if (what.starts_with('/') && what.size() > 1) return Ros2ToolAddress{what, {}, base};
  if (!what.empty() && !base.empty()) return Ros2ToolAddress{{}, what, base};
  return Error{Errc::invalid_argument,
               "ros2:" + std::string(address) +
                   " names no tool; write ros2:/POSE_TOPIC[@CAMERA_FRAME] or "
                   "ros2:TOOL_FRAME@CAMERA_FRAME, e.g. ros2:tool0@camera_depth_optical_frame"};
}

Result<std::unique_ptr<HapticDevice>> open_ros2_device(std::string_view address) {
  auto parsed = parse_ros2_tool(address);
  if (!parsed) return parsed.error();
  if (const auto& api = dds::api(); !api) return api.error();
  return std::unique_ptr<HapticDevice>(std::make_unique<PollingDevice>(
      std::make_unique<Ros2Tool>(*std::move(parsed), "ros2:" + std::string(address))));
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

}  // namespace palpate::inline v0
