// States of joints and frames that come over ROS 2, by Cyclone DDS on this computer alone.
#include <gtest/gtest.h>
#include <unistd.h>

#include <algorithm>
#include <atomic>
#include <chrono>
#include <cstdlib>
#include <fstream>
#include <functional>
#include <thread>

#include "src/cameras/internal/robot_model.h"
#include "src/cameras/stream/posed_source.h"
#include "src/core/internal/monotonic_clock.h"
#include "src/io/internal/ros_messages.h"
#include "src/ros/internal/dds_api.h"
#include "src/ros/internal/ros_node.h"
#include "tests/cameras/robot_scene.h"
#include "tests/test_util/temporary_folder.h"

namespace palpate {
namespace {

/// Frames of the arm at rest, each captured when it is requested, or later.
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
    if (before_next) before_next();
    frame = shown_;
    frame.timestamp = monotonic_now() + later;
    return true;
  }

  int num_left = 1;
  double later = 0;  ///< s
  std::function<void()> before_next;

 private:
  const DepthFrame shown_;
  DepthStreamInfo info_;
};

/// A robot that publishes its joint states every 5 ms, on a clock of its own.
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

/// A robot that swings, and publishes joint states and tf each 10 ms of its own clock: `lead` s
/// before the image of the same moment, or after it if negative.
class SwingingRobot {
 public:
  static constexpr double kClock = 1000;  // s: its stamps at the first image
  static constexpr int kOldest = -50;     // of its messages, each 10 ms
  SwingingRobot(const RosNodeOptions& options, double lead)
      : lead_(lead), node_(RosNode::join(options).value()) {
    const RosQos kept{.is_reliable = true, .is_kept = true, .depth = 1};
    joints_ = node_->publish("/arm/joint_states", "sensor_msgs/JointState", {}).value();
    tf_ = node_->publish("/tf", "tf2_msgs/TFMessage", {}).value();
    fixed_ = node_->publish("/tf_static", "tf2_msgs/TFMessage", kept).value();
    const RosTransform still[] = {{"camera", "base", test::SwingingArm::base()},
                                  {"forearm", "hand", {{0, 0, 0.3}, axis_angle({0, 0, 1}, 0.5)}}};
    fixed_->publish(transform_message(0, still));
    thread_ = std::thread([this] {
      // Sends new data at once, and all of the last second repeatedly: sensor data may be lost.
      for (int newest = kOldest - 1, again = kOldest; !is_over_;) {
        if (0.01 * (newest + 1) <= now() + lead_ + 1e-6) {
          tell(++newest);
        } else {
          again = again < newest ? again + 1 : kOldest;
          tell(again);
        }
        std::this_thread::sleep_for(std::chrono::milliseconds(5));  // readers keep the last 100
      }
    });
  }
  ~SwingingRobot() {
    is_over_ = true;
    thread_.join();
  }
  /// An image of that moment, s after the first one, comes now.
  void see(double moment) {
    moment_ = moment;
    seen_ = monotonic_now();
  }

 private:
  double now() const {
    return seen_ == 0 ? -0.2 : moment_ + std::min(monotonic_now() - seen_, 0.1);
  }
  void tell(int k) {
    const auto ns = static_cast<std::uint64_t>(kClock * 1e9) +
                    static_cast<std::uint64_t>(10000000LL * (k + 100)) - 1000000000ULL;
    const double t = 0.01 * k;
    const std::string names[] = {"shoulder", "elbow"};
    const double positions[] = {test::SwingingArm::shoulder(t), test::SwingingArm::elbow(t)};
    joints_->publish(joint_state_message({ns, ""}, names, positions));
    const RosTransform moving[] = {
        {"base", "upper_arm", {{}, axis_angle({1, 0, 0}, positions[0])}},
        {"upper_arm", "forearm", {{0, 0, 0.3}, axis_angle({1, 0, 0}, positions[1])}}};
    tf_->publish(transform_message(ns, moving));
  }

  const double lead_;
  const std::shared_ptr<RosNode> node_;
  std::unique_ptr<RosPublisher> joints_, tf_, fixed_;
  std::atomic<double> moment_ = 0, seen_ = 0;
  std::atomic<bool> is_over_ = false;
  std::thread thread_;
};

/// Frames of the arm that swings, stamped by the robot's clock.
class StampedFrames : public DepthSource {
 public:
  StampedFrames(const std::vector<DepthFrame>& frames, SwingingRobot& robot)
      : frames_(frames), robot_(robot) {
    info_.width = frames.front().width;
    info_.height = frames.front().height;
    info_.intrinsics = {525, 525, 319.5, 239.5};
    info_.is_live = true;
  }
  const DepthStreamInfo& info() const override { return info_; }
  Result<bool> next(DepthFrame& frame) override {
    if (next_ == frames_.size()) return false;
    frame = frames_[next_++];
    robot_.see(frame.timestamp);
    frame.stamp = SwingingRobot::kClock + frame.timestamp;
    frame.timestamp = monotonic_now();
    return true;
  }

 private:
  const std::vector<DepthFrame>& frames_;
  SwingingRobot& robot_;
  DepthStreamInfo info_;
  std::size_t next_ = 0;
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
    EXPECT_NE(notes[1].find("2 depth images were dropped"), std::string::npos) << notes[1];
    // Live states do not apply to recorded frames.
    EXPECT_FALSE(
        filter->applied_to(std::make_unique<test::FrameList>(std::vector<DepthFrame>{shown})));
  }

  /// Pixels are removed as they are by the poses of the images' stamps.
  void expect_the_arm_of_the_stamps(
      double lead, const std::function<void()>& before = [] {}) {
    const auto shown = test::frames_of_arm([](double) { return Pose{}; }, true);
    const auto filter_by = [&](double late) {
      class Late : public LinkPoses {
       public:
        explicit Late(double by) : by_(by) {}
        Status at(double time, std::span<Pose> X_WL) const override {
          const auto poses = test::SwingingArm::poses(time - by_);
          std::copy(poses.begin(), poses.end(), X_WL.begin());
          return Done{};
        }

       private:
        double by_;
      };
      return parse_arm(std::make_shared<Late>(late));
    };
    auto exact = filter_by(0).applied_to(std::make_unique<test::FrameList>(shown)).value();
    auto wrong = filter_by(lead).applied_to(std::make_unique<test::FrameList>(shown)).value();
    SwingingRobot robot(robot_node(), lead);
    const auto filter = open_self_filter(files_, options_);
    ASSERT_TRUE(filter) << filter.error().message;
    auto source = filter->applied_to(std::make_unique<StampedFrames>(shown, robot)).value();
    before();
    DepthFrame frame, desired, not_desired;
    int num_different = 0;
    for (std::size_t k = 0; k < shown.size(); ++k) {
      ASSERT_TRUE(*source->next(frame)) << k;
      ASSERT_TRUE(*exact->next(desired) && *wrong->next(not_desired));
      int num_wrong = 0;
      for (std::size_t i = 0; i < frame.pixels.size(); ++i) {
        num_wrong += frame.pixels[i] != desired.pixels[i];
        num_different += not_desired.pixels[i] != desired.pixels[i];
      }
      EXPECT_LE(num_wrong, 10) << "frame " << k;  // of rims, by rounding
    }
    EXPECT_GT(num_different, 10000);  // so far does the arm swing in that time
    EXPECT_TRUE(source->take_notes().empty());
  }
  /// Its links as the files have them, round ones drawn around.
  SelfFilter parse_arm(std::shared_ptr<const LinkPoses> poses) const {
    auto model = parse_urdf(test::kArmUrdf, "arm.urdf", {}, RobotGeometry::collision).value();
    std::erase_if(model.links, [](const RobotLink& link) { return link.mesh.triangles.empty(); });
    return SelfFilter::create(std::move(model.links), std::move(poses), options_).value();
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

// Nobody could read a note for each frame, and a run of hours would keep all of them.
TEST_F(RobotOverRos, WhoseCameraIsNowhereIsToldOnce) {
  const PublishingRobot robot(robot_node());
  const CameraUri uri =
      parse_camera_uri("live?urdf=" + files_.robot + "#hand&joints=ros2:/arm/joint_states").value();
  auto poses = CameraPoses::of(uri);
  ASSERT_TRUE(poses) << poses.error().message;
  auto frames =
      std::make_unique<LiveFrames>(test::frames_of_arm([](double) { return Pose{}; }, false)[0]);
  LiveFrames& camera = *frames;
  const auto posed = make_posed(std::move(frames), *std::move(poses)).value();
  camera.num_left = 300;
  camera.later = 60;  // after the last state
  std::vector<std::string> notes;
  camera.before_next = [&] {
    for (std::string& note : posed->take_notes()) notes.push_back(std::move(note));
  };
  DepthFrame frame;
  EXPECT_FALSE(*posed->next(frame));
  camera.before_next();
  ASSERT_EQ(notes.size(), 2u);
  EXPECT_NE(notes[0].find("live: frames are dropped: no state for joint"), std::string::npos)
      << notes[0];
  EXPECT_NE(notes[1].find("300 frames were dropped"), std::string::npos) << notes[1];
}

TEST_F(RobotOverRos, TellsOfItsFrames) {
  const PublishingRobot robot(robot_node());
  files_.joints = "ros2:?world=camera";
  expect_no_arm();
}

TEST_F(RobotOverRos, SwingsFastAndItsJointsComeEarlyOrLate) {
  files_.joints = "ros2:/arm/joint_states";
  files_.pose = "-0.35 0.1 0.8 0 0.70710678118654757 0 0.70710678118654757";
  for (const double lead : {0.08, -0.08}) expect_the_arm_of_the_stamps(lead);
}

TEST_F(RobotOverRos, SwingsFastAndItsFramesComeEarlyOrLate) {
  files_.joints = "ros2:?world=camera";
  for (const double lead : {0.08, -0.08}) expect_the_arm_of_the_stamps(lead);
}

TEST_F(RobotOverRos, GoesByStampsAgainAfterStatesWithoutThem) {
  files_.joints = "ros2:/arm/joint_states";
  files_.pose = "-0.35 0.1 0.8 0 0.70710678118654757 0 0.70710678118654757";
  const auto node = RosNode::join(robot_node()).value();
  const auto gripper = node->publish("/arm/joint_states", "sensor_msgs/JointState", {}).value();
  expect_the_arm_of_the_stamps(0.08, [&] {
    const std::string names[] = {"finger"};
    const double positions[] = {0.1};
    for (int k = 0; k < 30; ++k) {
      gripper->publish(joint_state_message({}, names, positions));
      std::this_thread::sleep_for(std::chrono::milliseconds(20));
    }
    std::this_thread::sleep_for(std::chrono::milliseconds(7000));  // they count for 5 s
  });
}

TEST_F(RobotOverRos, ThatIsSilentIsToldOf) {
  files_.joints = "ros2:/nobody";
  const auto filter = open_self_filter(files_, options_);
  ASSERT_FALSE(filter);
  EXPECT_NE(filter.error().message.find("ros2:/nobody has no states for joints"), std::string::npos)
      << filter.error().message;
}

}  // namespace
}  // namespace palpate
