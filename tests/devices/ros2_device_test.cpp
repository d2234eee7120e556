// Names of a tool that a robot holds.
#include "src/devices/software/ros2_device.h"

#include <gtest/gtest.h>

namespace palpate {
namespace {

TEST(Ros2Tool, is_a_topic_or_a_frame) {
  const auto topic = parse_ros2_tool("/arm/tool_pose");
  ASSERT_TRUE(topic);
  EXPECT_EQ(topic->topic, "/arm/tool_pose");
  EXPECT_EQ(topic->base, "");
  const auto reported = parse_ros2_tool("/tool_pose@camera");
  ASSERT_TRUE(reported);
  EXPECT_EQ(reported->topic, "/tool_pose");
  EXPECT_EQ(reported->base, "camera");
  const auto frame = parse_ros2_tool("tool0@camera");
  ASSERT_TRUE(frame);
  EXPECT_EQ(frame->topic, "");
  EXPECT_EQ(frame->frame, "tool0");
  EXPECT_EQ(frame->base, "camera");
  EXPECT_EQ(frame->max_age, 0.1);
  EXPECT_FALSE(frame->has_our_clock);
  const auto both = parse_ros2_tool("tool0@camera?max_age=2.5&clock=shared");
  ASSERT_TRUE(both);
  EXPECT_EQ(both->base, "camera");
  EXPECT_EQ(both->max_age, 2.5);
  EXPECT_TRUE(both->has_our_clock);
  EXPECT_FALSE(parse_ros2_tool("/pose?clock=own")->has_our_clock);
  for (const char* wrong : {"a@b?x", "a@b?max_age=0", "a@b?max_age=ms", "/a?clock=ours", "/a?="}) {
    const auto none = parse_ros2_tool(wrong);
    ASSERT_FALSE(none) << wrong;
    EXPECT_NE(none.error().message.find("is not known; there are max_age"), std::string::npos);
  }
  for (const char* wrong : {"", "tool0", "@camera", "/", "tool0@", "tool0?max_age=1"}) {
    const auto none = parse_ros2_tool(wrong);
    ASSERT_FALSE(none) << wrong;
    EXPECT_NE(none.error().message.find("ros2:/POSE_TOPIC"), std::string::npos);
  }
}

}  // namespace
}  // namespace palpate
