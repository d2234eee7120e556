// States of joints and frames that come over ROS 2, by Cyclone DDS on this computer alone.
#include <gtest/gtest.h>
#include <unistd.h>

#include <atomic>
#include <chrono>
#include <cstdlib>
#include <fstream>
#include <thread>

#include "src/core/monotonic_clock.h"
#include "src/io/ros_messages.h"
#include "src/ros/dds_api.h"
#include "src/ros/ros_node.h"
#include "tests/cameras/robot_scene.h"
#include "tests/test_util/temporary_folder.h"

namespace palpate {
namespace {

/// Frames of the arm at rest, each captured when it is asked for, or later.
class LiveFrames : public DepthSource {
 public:
  explicit LiveFrames(DepthFrame shown) : shown_(std::move(shown)) {
    info_.width = shown_.width;
    info_.height = shown_.height;
    info_.intrinsics = {525, 525, 319.5, 239.5};
    info_.name = "live";
    info_.is_live = true;
  }
  const DepthStreamInfo& info() const override { return info_; }
  Result<bool> next(DepthFrame& frame) override {
    if (num_left == 0) return false;
    --num_left;
    frame = shown_;
    frame.timestamp = monotonic_now() + later;
    return true;
  }

  int num_left = 1;
  double later = 0;  ///< s

 private:
  const DepthFrame shown_;
  DepthStreamInfo info_;
};

/// A robot that publishes where its arm is, every 5 ms, on a clock of its own.
class PublishingRobot {
 public:
  explicit PublishingRobot(const RosNodeOptions& options) : node_(RosNode::join(options).value()) {
    const RosQos kept{.is_reliable = true, .is_kept = true, .depth = 1};
    joints_ = node_->publish("/arm/joint_states", "sensor_msgs/JointState", {}).value();
    gripper_ = node_->publish("/arm/joint_states", "sensor_msgs/JointState", {}).value();
    tf_ = node_->publish("/tf", "tf2_msgs/TFMessage", {}).value();
    fixed_ = node_->publish("/tf_static", "tf2_msgs/TFMessage", kept).value();
    thread_ = std::thread([this] {
      while (!is_over_) {
        publish();
        std::this_thread::sleep_for(std::chrono::milliseconds(5));
      }
    });
  }
  ~PublishingRobot() {
    is_over_ = true;
    thread_.join();
  }

 private:
  void publish() {
    constexpr double kItsClock = 5e8;  // s before ours
    const auto ns = static_cast<std::uint64_t>((monotonic_now() + kItsClock) * 1e9);
    const std::string shoulder[] = {"shoulder"}, elbow[] = {"elbow"};
    const double positions[] = {test::SwingingArm::shoulder(0)},
                 bent[] = {test::SwingingArm::elbow(0)};
    joints_->publish(joint_state_message({ns, ""}, shoulder, positions));
    gripper_->publish(joint_state_message({ns, ""}, elbow, bent));
    const RosTransform moving[] = {
        {"base", "upper_arm", {{}, axis_angle({1, 0, 0}, positions[0])}},
        {"upper_arm", "forearm", {{0, 0, 0.3}, axis_angle({1, 0, 0}, bent[0])}}};
    tf_->publish(transform_message(ns, moving));
    const RosTransform still[] = {{"camera", "base", test::SwingingArm::base()},
                                  {"forearm", "hand", {{0, 0, 0.3}, axis_angle({0, 0, 1}, 0.5)}}};
    fixed_->publish(transform_message(ns, still));
  }

  const std::shared_ptr<RosNode> node_;
  std::unique_ptr<RosPublisher> joints_, gripper_, tf_, fixed_;
  std::atomic<bool> is_over_ = false;
  std::thread thread_;
};

class RobotOverRos : public testing::Test {
 protected:
  void SetUp() override {
    if (!dds::api()) GTEST_SKIP() << "SKIPPED: " << dds::api().error().message;
    // A domain of its own for every test program that runs at once.
    setenv("ROS_DOMAIN_ID", std::to_string(100 + getpid() % 100).c_str(), 1);
    setenv("ROS_LOCALHOST_ONLY", "1", 1);
    std::ofstream(folder_ / "arm.urdf") << test::kArmUrdf;
    files_.robot = folder_ / "arm.urdf";
    options_.max_age = 5;  // of a computer that has much else to do
  }
  static RosNodeOptions robot_node() {
    RosNodeOptions options = RosNodeOptions::of_environment().value();
    options.name = "robot";
    return options;
  }
  void expect_no_arm() {
    auto filter = open_self_filter(files_, options_);
    ASSERT_TRUE(filter) << filter.error().message;
    const DepthFrame shown = test::frames_of_arm([](double) { return Pose{}; }, true)[0];
    const DepthFrame table = test::frames_of_arm([](double) { return Pose{}; }, false)[0];
    auto frames = std::make_unique<LiveFrames>(shown);
    LiveFrames& camera = *frames;
    auto source = filter->applied_to(std::move(frames)).value();
    DepthFrame frame;
    ASSERT_TRUE(*source->next(frame));
    int num_arm = 0;
    for (std::size_t i = 0; i < frame.pixels.size(); ++i) {
      if (shown.pixels[i] == table.pixels[i]) continue;
      ++num_arm;
      ASSERT_EQ(frame.pixels[i], 0) << i;
    }
    EXPECT_GT(num_arm, 8000);
    EXPECT_TRUE(source->take_notes().empty());
    // Long after the last state nobody knows where the arm is.
    camera.num_left = 2;
    camera.later = 60;
    EXPECT_FALSE(*source->next(frame));
    const auto notes = source->take_notes();
    ASSERT_EQ(notes.size(), 2u);
    EXPECT_NE(notes[1].find("2 depth images were left out"), std::string::npos) << notes[1];
    // Live states do not tell of recorded frames.
    EXPECT_FALSE(
        filter->applied_to(std::make_unique<test::FrameList>(std::vector<DepthFrame>{shown})));
  }

  const test::TemporaryFolder folder_;
  RobotFiles files_;
  SelfFilterOptions options_;
};

TEST_F(RobotOverRos, TellsOfItsJoints) {
  const PublishingRobot robot(robot_node());
  files_.joints = "ros2:/arm/joint_states";
  files_.pose = "-0.35 0.1 0.8 0 0.70710678118654757 0 0.70710678118654757";
  expect_no_arm();
}

TEST_F(RobotOverRos, TellsOfItsFrames) {
  const PublishingRobot robot(robot_node());
  files_.joints = "ros2:?world=camera";
  expect_no_arm();
}

TEST_F(RobotOverRos, ThatIsSilentIsToldOf) {
  files_.joints = "ros2:/nobody";
  const auto filter = open_self_filter(files_, options_);
  ASSERT_FALSE(filter);
  EXPECT_NE(filter.error().message.find("ros2:/nobody tells nothing of joints"), std::string::npos)
      << filter.error().message;
}

}  // namespace
}  // namespace palpate
