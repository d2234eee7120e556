// Names and hashes of message types against what ROS 2 itself prints.
#include "src/io/internal/ros_types.h"

#include <gtest/gtest.h>

#include <cmath>

#include "src/io/internal/hashes.h"
#include "src/io/internal/ros_messages.h"

namespace palpate {
namespace {

TEST(Sha256, is_that_of_the_standard) {
  // FIPS 180-4, examples of NIST.
  EXPECT_EQ(sha256("abc"), "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad");
  EXPECT_EQ(sha256("abcdbcdecdefdefgefghfghighijhijkijkljklmklmnlmnomnopnopq"),
            "248d6a61d20638b8e5c026930c3e6039a33ce45964ff2167f6ecedd419db06c1");
  EXPECT_EQ(sha256(std::string(1000000, 'a')),
            "cdc76e5c9914fb9281a1c7e284d73e67f1809a48a497200e046d39ccc7112cd0");
}

TEST(RosTypes, have_the_hashes_that_ros2_topic_info_prints) {
  const std::pair<const char*, const char*> printed[] = {
      {"sensor_msgs/Image", "d31d41a9a4c4bc8eae9be757b0beed306564f7526c88ea6a4588fb9582527d47"},
      {"sensor_msgs/CompressedImage",
       "15640771531571185e2efc8a100baf923961a4d15d5569652e6cb6691e8e371a"},
      {"sensor_msgs/CameraInfo",
       "b3dfd68ff46c9d56c80fd3bd4ed22c7a4ddce8c8348f2f59c299e73118e7e275"},
      {"sensor_msgs/JointState",
       "a13ee3a330e346c9d87b5aa18d24e11690752bd33a0350f11c5882bc9179260e"},
      {"sensor_msgs/PointCloud2",
       "9198cabf7da3796ae6fe19c4cb3bdd3525492988c70522628af5daa124bae2b5"},
      {"tf2_msgs/TFMessage", "e369d0f05a23ae52508854b66f6aa0437f3449d652e8cbf22d5abe85d020f087"},
      {"geometry_msgs/PoseStamped",
       "10f3786d7d40fd2b54367835614bff85d4ad3b5dab62bf8bca0cc232d73b4cd8"},
      {"geometry_msgs/WrenchStamped",
       "8dc3deaf06b2ab281f9f9a742a8961c328ca7cec16e3fd6586d3a5c83fa78f77"},
      {"geometry_msgs/TwistStamped",
       "5f0fcd4f81d5d06ad9b4c4c63e3ea51b82d6ae4d0558f1d475229b1121db6f64"},
      {"geometry_msgs/Quaternion",
       "8a765f66778c8ff7c8ab94afcc590a2ed5325a1d9a076ffff38fbce36f458684"},
      {"std_msgs/Header", "f49fb3ae2cf070f793645ff749683ac6b06203e41c891e17701b1cb597ce6a01"},
  };
  for (const auto& [type, hash] : printed) {
    EXPECT_EQ(ros_type_hash(type), std::string("RIHS01_") + hash) << type;
  }
}

TEST(RosTypes, have_names_for_ros_and_for_dds) {
  EXPECT_EQ(dds_type_name("sensor_msgs/Image"), "sensor_msgs::msg::dds_::Image_");
  EXPECT_EQ(ros_interface_name("sensor_msgs/Image"), "sensor_msgs/msg/Image");
}

TEST(RosMessages, read_back_what_was_written) {
  const Pose X{{1, -2, 3}, normalized(Quaternion{0.1, 0.2, 0.3, 0.9})};
  const auto pose = read_pose(pose_message({2'250'000'000, "camera"}, X));
  ASSERT_TRUE(pose);
  EXPECT_EQ(pose->time, 2.25);
  EXPECT_EQ(pose->frame, "camera");
  EXPECT_EQ(pose->pose.translation, X.translation);
  Pose wrong = X;
  wrong.rotation = {0, 0, 0, 0};
  EXPECT_FALSE(read_pose(pose_message({0, ""}, wrong)));
}

// A gripper that reports nothing, and the link behind it.
TEST(RosMessages, one_bad_joint_or_transform_spoils_no_other) {
  const std::string names[] = {"elbow", "finger"};
  const double positions[] = {0.1, std::nan("")};
  const auto state = read_joint_state(joint_state_message({1, ""}, names, positions));
  ASSERT_TRUE(state);
  ASSERT_EQ(state->names.size(), 2u);
  EXPECT_EQ(state->positions[0], 0.1);
  EXPECT_TRUE(std::isnan(state->positions[1]));
  const RosTransform transforms[] = {{"base", "arm", {{1, 0, 0}, {}}},
                                     {"arm", "finger", {{}, {0, 0, 0, 0}}},
                                     {"arm", "tip", {{std::nan(""), 0, 0}, {}}},
                                     {"arm", "tool", {{0, 2, 0}, {}}}};
  const auto read = read_transforms(transform_message(1, transforms));
  ASSERT_TRUE(read);
  ASSERT_EQ(read->size(), 2u);
  EXPECT_EQ(read->front().child, "arm");
  EXPECT_EQ(read->back().child, "tool");
  EXPECT_EQ(read->back().X_PC.translation, (Vec3d{0, 2, 0}));
}

}  // namespace
}  // namespace palpate
