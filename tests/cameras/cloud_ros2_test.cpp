// A cloud over ROS 2: the topic's type is followed, and its frames are the image.
#include <gtest/gtest.h>

#include <unistd.h>

#include <atomic>
#include <chrono>
#include <cstdlib>
#include <string>
#include <thread>

#include "palpate/cameras/cameras.h"
#include "src/ros/internal/dds_api.h"
#include "src/ros/internal/ros_node.h"
#include "tests/io/made_cloud.h"

namespace palpate {
namespace {

TEST(CloudRos2, ATopicOfCloudsIsACamera) {
  if (!dds::api()) GTEST_SKIP() << "SKIPPED: " << dds::api().error().message;
  const int domain = 100 + static_cast<int>(getpid() % 100);
  setenv("ROS_DOMAIN_ID", std::to_string(domain).c_str(), 1);
  setenv("ROS_LOCALHOST_ONLY", "1", 1);
  CloudPoints cloud{32, 24, {}, {}};
  for (int i = 0; i < 32 * 24; ++i) {
    const float z = 0.5f + 0.001f * static_cast<float>(i);
    cloud.points.push_back({z * (static_cast<float>(i % 32) - 15.5f) / 30,
                            z * (static_cast<float>(i / 32) - 11.5f) / 30, z});
  }
  const auto node = RosNode::join({"sender", "/test", domain, true});
  ASSERT_TRUE(node) << node.error().message;
  const auto writer = (*node)->publish("/points", "sensor_msgs/PointCloud2", RosQos::sensor());
  ASSERT_TRUE(writer) << writer.error().message;
  std::atomic<bool> is_over = false;
  std::thread sender([&] {
    for (int k = 0; !is_over; ++k) {
      const auto& layouts = test::CloudLayout::three();
      (*writer)->publish(test::cloud_message(cloud.view(), layouts[static_cast<std::size_t>(k) % 3],
                                             1000 + 0.03 * k));
      std::this_thread::sleep_for(std::chrono::milliseconds(30));
    }
  });
  auto camera = open_camera("ros2:/points");
  DepthFrame frame;
  for (int k = 0; camera && k < 5; ++k) {
    const auto got = (*camera)->next(frame);
    EXPECT_TRUE(got && *got);
    EXPECT_EQ(frame.pixels[0], 500);
    EXPECT_EQ(frame.pixels.back(), 500 + 32 * 24 - 1);
  }
  is_over = true;
  sender.join();
  ASSERT_TRUE(camera) << camera.error().message;
  EXPECT_EQ((*camera)->info().intrinsics, (Intrinsics{30, 30, 15.5, 11.5}));
  EXPECT_EQ((*camera)->info().unit, 0.001);
  EXPECT_EQ((*camera)->info().frame, "cam");
}

}  // namespace
}  // namespace palpate
