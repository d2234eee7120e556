// Nodes that hear each other through Cyclone DDS, on this computer alone.
#include "src/ros/internal/ros_node.h"

#include <gtest/gtest.h>

#include <cstdlib>
#include <mutex>

#include "src/io/internal/ros_messages.h"
#include "src/ros/internal/dds_api.h"
#include "tests/test_util/wait_for.h"

namespace palpate {
namespace {

class RosNodeTest : public testing::Test {
 protected:
  void SetUp() override {
    if (!dds::api()) GTEST_SKIP() << "SKIPPED: " << dds::api().error().message;
  }
  /// A domain of its own for every test program that runs at once.
  static RosNodeOptions options(const std::string& name) {
    return {name, "/test", 100 + static_cast<int>(getpid() % 100), true};
  }
};

struct Received {
  std::mutex mutex;
  std::vector<std::string> messages;

  RosNode::MessageHandler listener() {
    return [this](std::string_view message) {
      const std::lock_guard lock(mutex);
      messages.emplace_back(message);
    };
  }
  std::size_t size() {
    const std::lock_guard lock(mutex);
    return messages.size();
  }
};

TEST_F(RosNodeTest, nodes_hear_each_other_to_the_byte) {
  const auto a = RosNode::join(options("a")), b = RosNode::join(options("b"));
  ASSERT_TRUE(a) << a.error().message;
  ASSERT_TRUE(b) << b.error().message;
  Received received;
  const auto reader =
      (*b)->subscribe("wrench", "geometry_msgs/WrenchStamped", {}, received.listener());
  ASSERT_TRUE(reader) << reader.error().message;
  const auto writer = (*a)->publish("/test/wrench", "geometry_msgs/WrenchStamped", {});
  ASSERT_TRUE(writer) << writer.error().message;
  ASSERT_TRUE(test::wait_for([&] { return (*writer)->num_readers() == 1; }));
  ASSERT_TRUE(test::wait_for([&] { return (*reader)->num_writers() == 1; }));
  const std::string message = wrench_message({7, "tool"}, {{1, 2, 3}, {4, 5, 6}});
  EXPECT_TRUE((*writer)->publish(message));
  ASSERT_TRUE(test::wait_for([&] { return received.size() == 1; }));
  EXPECT_EQ(received.messages[0], message);
  EXPECT_FALSE((*writer)->publish(message.substr(0, 20)));
  const auto topics = (*b)->topics();
  EXPECT_NE(std::find(topics.begin(), topics.end(),
                      RosTopic{"/test/wrench", "geometry_msgs/WrenchStamped"}),
            topics.end());
}

TEST_F(RosNodeTest, who_comes_late_gets_what_is_kept) {
  const auto a = RosNode::join(options("a")), b = RosNode::join(options("b"));
  ASSERT_TRUE(a && b);
  const RosQos kept{.is_reliable = true, .is_kept = true, .depth = 1};
  const RosTransform transforms[] = {{"world", "camera", {}}};
  const std::string message = transform_message(5, transforms);
  const auto writer = (*a)->publish("/tf_static", "tf2_msgs/TFMessage", kept);
  ASSERT_TRUE(writer);
  EXPECT_TRUE((*writer)->publish(message));
  Received received;
  const auto reader =
      (*b)->subscribe("/tf_static", "tf2_msgs/TFMessage", kept, received.listener());
  ASSERT_TRUE(test::wait_for([&] { return received.size() == 1; }));
  EXPECT_EQ(received.messages[0], message);
}

TEST_F(RosNodeTest, nodes_with_the_same_options_are_one) {
  const auto a = RosNode::join(options("a")), again = RosNode::join(options("a"));
  ASSERT_TRUE(a && again);
  EXPECT_EQ(*a, *again);
}

TEST(RosNodeOptions, come_from_the_environment) {
  setenv("ROS_DOMAIN_ID", "17", 1);
  setenv("ROS_LOCALHOST_ONLY", "1", 1);
  const auto options = RosNodeOptions::of_environment();
  ASSERT_TRUE(options);
  EXPECT_EQ(options->domain, 17);
  EXPECT_TRUE(options->is_local);
  for (const char* wrong : {"x", "233", "-1", "1.5"}) {
    setenv("ROS_DOMAIN_ID", wrong, 1);
    EXPECT_FALSE(RosNodeOptions::of_environment()) << wrong;
  }
  unsetenv("ROS_DOMAIN_ID");
  unsetenv("ROS_LOCALHOST_ONLY");
}

TEST(FullTopic, puts_names_into_the_namespace) {
  EXPECT_EQ(full_topic("wrench", "/"), "/wrench");
  EXPECT_EQ(full_topic("wrench", "/arm"), "/arm/wrench");
  EXPECT_EQ(full_topic("/wrench", "/arm"), "/wrench");
}

TEST(CheckTopic, knows_the_names_of_ros) {
  for (const char* const good : {"/a", "/camera/depth/image_raw", "/A_1/b2", "/_hidden/x__y"}) {
    EXPECT_TRUE(check_topic(good)) << good;
  }
  for (const char* const bad : {"", "/", "a", "/a/", "//a", "/a//b", "/bad topic!", "/1a", "/a/2",
                                "/a-b", "/\xc3\xa4", "/a\n"}) {
    const Status status = check_topic(bad);
    ASSERT_FALSE(status) << bad;
    EXPECT_NE(status.error().message.find("no ROS topic can be called"), std::string::npos);
  }
}

}  // namespace
}  // namespace palpate
