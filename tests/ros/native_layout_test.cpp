// Messages as structures of C.
#include "src/ros/native_layout.h"

#include <gtest/gtest.h>

#include "src/io/internal/ros_messages.h"

namespace palpate {
namespace {

TEST(NativeLayout, is_that_of_a_structure_of_c) {
  // As idlc 0.10.2 lays out std_msgs::msg::dds_::Header_ and geometry_msgs' WrenchStamped_.
  struct Header {
    std::int32_t sec;
    std::uint32_t nanosec;
    char* frame_id;
  };
  struct WrenchStamped {
    Header header;
    double force[3], torque[3];
  };
  EXPECT_EQ(NativeLayout("geometry_msgs/WrenchStamped").size(), sizeof(WrenchStamped));
  const std::string message = wrench_message({1'500'000'000, "tool"}, {{1, 2, 3}, {4, 5, 6}});
  const NativeLayout layout("geometry_msgs/WrenchStamped");
  const auto native = layout.to_native(message);
  ASSERT_TRUE(native);
  const auto* const seen = static_cast<const WrenchStamped*>(native->get());
  EXPECT_EQ(seen->header.sec, 1);
  EXPECT_EQ(seen->header.nanosec, 500'000'000u);
  EXPECT_STREQ(seen->header.frame_id, "tool");
  EXPECT_EQ(seen->torque[2], 6);
}

TEST(NativeLayout, refuses_damaged_messages) {
  const NativeLayout layout("tf2_msgs/TFMessage");
  const RosTransform transforms[] = {{"world", "camera", {}}};
  const std::string message = transform_message(1, transforms);
  ASSERT_TRUE(layout.to_native(message));
  for (std::size_t size = 0; size < message.size(); ++size) {
    EXPECT_FALSE(layout.to_native(message.substr(0, size))) << size;
    EXPECT_FALSE(read_transforms(message.substr(0, size))) << size;
  }
  std::string many = message;
  many[4] = many[5] = many[6] = many[7] = '\xff';
  EXPECT_FALSE(layout.to_native(many));
}

}  // namespace
}  // namespace palpate
