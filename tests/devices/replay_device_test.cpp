#include <gtest/gtest.h>

#include <chrono>
#include <cmath>
#include <filesystem>
#include <fstream>
#include <string>
#include <thread>
#include <vector>

#include "palpate/io/files.h"
#include "src/devices/device_kinds.h"
#include "tests/test_util/temporary_folder.h"

namespace palpate {
namespace {

std::string path_of(const std::string& name) {
  static const test::TemporaryFolder folder;
  return folder / name;
}

/// Half a turn in 0.3 s, on a slope; stamps like those of a camera.
std::vector<TimedPose> turning_path() {
  std::vector<TimedPose> poses;
  for (int i = 0; i <= 10; ++i)
    poses.push_back(
        {1.7e9 + 0.03 * i, {{0.02 * i, 0, 0.5 - 0.01 * i}, axis_angle({0, 0, 1}, 0.3 * i)}});
  return poses;
}

TEST(ReplayDevice, PlaysAPathInRealTimeAndEndsWithIt) {
  const auto poses = turning_path();
  ASSERT_TRUE(save_trajectory(poses, path_of("path.txt")));
  auto device = open_replay_device(path_of("path.txt"));
  ASSERT_TRUE(device.has_value()) << device.error().message;
  EXPECT_EQ((*device)->info().kind, "replay");
  EXPECT_GT((*device)->info().limits.max_force, 0);

  std::vector<DeviceState> states;
  states.reserve(2000);
  ASSERT_TRUE((*device)->start([&states](const DeviceState& state) {
    states.push_back(state);
    return Wrench{{5, 0, 0}, {}};
  }));
  for (int i = 0; i < 1000 && (*device)->status().has_value(); ++i)
    std::this_thread::sleep_for(std::chrono::milliseconds(5));
  const Status status = (*device)->status();
  (*device)->stop();
  ASSERT_FALSE(status.has_value());
  EXPECT_EQ(status.error().code, Errc::cancelled);
  EXPECT_EQ(status.error().message.rfind("the path ", 0), 0u);

  ASSERT_FALSE(states.empty());
  for (const DeviceState& state : states) {
    const double time = state.time - states.front().time;
    ASSERT_TRUE(state.is_valid);
    EXPECT_LE(time, 0.3 + 1e-6);
    // The path is straight and turns steadily: position, angle and velocity in closed form.
    EXPECT_NEAR(state.X_BH.translation.x, 0.02 * time / 0.03, 1e-6);
    EXPECT_NEAR(state.X_BH.translation.z, 0.5 - 0.01 * time / 0.03, 1e-6);
    EXPECT_NEAR(2 * std::atan2(state.X_BH.rotation.z, state.X_BH.rotation.w), 10 * time, 1e-5);
    EXPECT_NEAR(state.V_BH.linear.x, 0.02 / 0.03, 1e-3);
    EXPECT_NEAR(state.V_BH.angular.z, 10, 2e-2);
  }
}

TEST(ReplayDevice, PlaysAgainFromTheBeginning) {
  ASSERT_TRUE(save_trajectory({{5, {{1, 2, 3}, {}}}}, path_of("point.txt")));  // one tick
  auto device = open_replay_device(path_of("point.txt"));
  ASSERT_TRUE(device.has_value());
  for (int round = 0; round < 2; ++round) {
    int num_ticks = 0;
    ASSERT_TRUE((*device)->start([&](const DeviceState& state) {
      EXPECT_EQ(state.X_BH.translation, (Vec3d{1, 2, 3}));
      EXPECT_EQ(state.V_BH.linear, Vec3d{});
      ++num_ticks;
      return Wrench{};
    }));
    for (int i = 0; i < 1000 && (*device)->status().has_value(); ++i)
      std::this_thread::sleep_for(std::chrono::milliseconds(5));
    (*device)->stop();
    EXPECT_EQ(num_ticks, 1);
  }
}

TEST(ReplayDevice, SaysWhatIsWrongWithTheFile) {
  EXPECT_EQ(open_replay_device("").error().code, Errc::invalid_argument);
  EXPECT_FALSE(open_replay_device(path_of("nowhere.txt")).has_value());
  EXPECT_FALSE(open_replay_device(::testing::TempDir()).has_value());
  std::ofstream(path_of("bad.txt")) << "0 0 0 0 0 0 0 1\n1 2 3\n";
  const auto bad = open_replay_device(path_of("bad.txt"));
  ASSERT_FALSE(bad.has_value());
  EXPECT_NE(bad.error().message.find("line 2"), std::string::npos);
}

}  // namespace
}  // namespace palpate
