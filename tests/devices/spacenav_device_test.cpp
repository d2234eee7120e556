#include <gtest/gtest.h>

#include <chrono>
#include <climits>
#include <cmath>
#include <cstdlib>
#include <fstream>
#include <functional>
#include <memory>
#include <mutex>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include "src/devices/device_kinds.h"
#include "src/devices/spacenav/spacenav_connection.h"
#include "tests/devices/fake_spacenavd.h"
#include "tests/test_util/allocation_counter.h"

namespace palpate {
namespace {

using test::FakeSpacenavd;
using Answer = SpacenavConnection::Answer;

TEST(SpacenavConnection, PutsEventsTogetherFromPieces) {
  FakeSpacenavd daemon;
  auto connection = SpacenavConnection::open(daemon.path());
  ASSERT_TRUE(connection.has_value()) << connection.error().message;
  daemon.accept();
  SpacenavConnection::Event event{};
  EXPECT_EQ(connection->next(event), Answer::nothing_yet);
  const SpacenavConnection::Event sent{0, 1, -2, 3, -4, 5, INT_MIN, 7};
  const char* bytes = reinterpret_cast<const char*>(sent.data());
  for (std::size_t i = 0; i < sizeof sent; ++i) {
    EXPECT_EQ(connection->next(event), Answer::nothing_yet);
    daemon.send_bytes(bytes + i, 1);
  }
  EXPECT_EQ(connection->next(event), Answer::event);
  EXPECT_EQ(event, sent);
  // Two at once, and half of a third one, then the end.
  daemon.button(1, true);
  daemon.button(1, false);
  daemon.send_bytes(bytes, 16);
  daemon.hang_up();
  EXPECT_EQ(connection->next(event), Answer::event);
  EXPECT_EQ(event[0], SpacenavConnection::kPress);
  EXPECT_EQ(connection->next(event), Answer::event);
  EXPECT_EQ(event[0], SpacenavConnection::kRelease);
  EXPECT_EQ(connection->next(event), Answer::closed);
}

TEST(SpacenavConnection, PassesOverUnknownEventsButNotOverGarbage) {
  FakeSpacenavd daemon;
  auto connection = SpacenavConnection::open(daemon.path());
  ASSERT_TRUE(connection.has_value());
  daemon.accept();
  SpacenavConnection::Event event{};
  for (const int type : {3, 4, 99, -1}) daemon.send({type, 1, 2, 3, 4, 5, 6, 7});
  daemon.button(0, true);
  EXPECT_EQ(connection->next(event), Answer::event);
  EXPECT_EQ(event[0], SpacenavConnection::kPress);
  const std::string garbage(2000, '?');
  daemon.send_bytes(garbage.data(), garbage.size());
  EXPECT_EQ(connection->next(event), Answer::not_understood);
}

TEST(SpacenavConnection, SaysWhatIsMissing) {
  const auto message = [](const std::string& path) {
    const auto connection = SpacenavConnection::open(path);
    EXPECT_FALSE(connection.has_value());
    return connection.has_value() ? "" : connection.error().message;
  };
  const std::string nowhere = ::testing::TempDir() + "/no_spnav.sock";
  EXPECT_NE(message(nowhere).find(nowhere), std::string::npos);
  EXPECT_NE(message(nowhere).find("install"), std::string::npos);
  const std::string file = ::testing::TempDir() + "/spnav_file";
  std::ofstream(file) << "not a socket";
  EXPECT_NE(message(file).find("refused"), std::string::npos);
  EXPECT_NE(message(std::string(200, 'x')).find("107"), std::string::npos);
  EXPECT_FALSE(open_spacenav_device(nowhere).has_value());
}

TEST(SpacenavConnection, FindsTheSocketAsLibspnavDoes) {
  ::unsetenv("SPNAV_SOCKET");
  EXPECT_EQ(spacenav_socket_path(""), "/var/run/spnav.sock");
  ::setenv("SPNAV_SOCKET", "/tmp/mine", 1);
  EXPECT_EQ(spacenav_socket_path(""), "/tmp/mine");
  EXPECT_EQ(spacenav_socket_path("/tmp/given"), "/tmp/given");
  ::unsetenv("SPNAV_SOCKET");
}

/// A device on a fake daemon, and the states it has ticked with.
class SpacenavDevice : public ::testing::Test {
 protected:
  void SetUp() override {
    auto device = open_spacenav_device(daemon_.path());
    ASSERT_TRUE(device.has_value()) << device.error().message;
    device_ = std::move(*device);
    daemon_.accept();
    states_.reserve(20000);
    start();
  }

  void start() {
    ASSERT_TRUE(device_->start([this](const DeviceState& state) {
      const std::lock_guard lock(mutex_);  // a test may wait
      if (states_.size() < states_.capacity()) states_.push_back(state);
      return Wrench{};
    }));
  }

  /// Until the newest state is like that; five seconds at most.
  bool comes(const std::function<bool(const DeviceState&)>& is_so) {
    for (int i = 0; i < 1000; ++i) {
      if (is_so(newest())) return true;
      std::this_thread::sleep_for(std::chrono::milliseconds(5));
    }
    return false;
  }
  bool is_lost() {
    for (int i = 0; i < 1000 && device_->status().has_value(); ++i)
      std::this_thread::sleep_for(std::chrono::milliseconds(5));
    return !device_->status().has_value();
  }
  DeviceState newest() {
    const std::lock_guard lock(mutex_);
    return states_.empty() ? DeviceState{} : states_.back();
  }

  FakeSpacenavd daemon_;
  std::mutex mutex_;
  std::vector<DeviceState> states_;
  std::unique_ptr<HapticDevice> device_;  // ticks until it goes
};

TEST_F(SpacenavDevice, RestsAtTheOriginUntilItIsPushed) {
  EXPECT_TRUE(comes([](const DeviceState& state) { return state.is_valid; }));
  daemon_.motion(9, -9, 5, 0, 10, -10);  // a cap that is not touched
  daemon_.button(1, true);
  EXPECT_TRUE(comes([](const DeviceState& state) { return state.buttons == 2; }));
  EXPECT_EQ(newest().X_BH, Pose{});
  daemon_.button(31, true);
  daemon_.button(32, true);  // more than there are bits
  daemon_.button(-1, true);
  daemon_.button(1, false);
  EXPECT_TRUE(comes([](const DeviceState& state) { return state.buttons == 0x80000000u; }));
}

TEST_F(SpacenavDevice, MovesAtTheSpeedOfThePush) {
  // Full to the right, half up, and away by more than there is; turned about the axes. Again and
  // again, as a push is over after half a second.
  DeviceState state;
  EXPECT_TRUE(comes([&](const DeviceState& now) {
    daemon_.motion(350, 180, 5000, -350, 0, INT_MIN);
    state = now;
    return now.X_BH.translation.x > 0.01 && now.V_BH.linear.x > 0;
  }));
  EXPECT_NEAR(state.V_BH.linear.x, 0.1, 1e-12);
  EXPECT_NEAR(state.V_BH.linear.y, 0.05, 1e-12);
  EXPECT_NEAR(state.V_BH.linear.z, -0.1, 1e-12);  // z is towards the hand
  EXPECT_NEAR(state.V_BH.angular.x, -1, 1e-12);
  EXPECT_EQ(state.V_BH.angular.y, 0);
  EXPECT_NEAR(state.V_BH.angular.z, 1, 1e-12);
  device_->stop();

  // The pose is the integral of the velocity, over steps of 20 ms at most.
  Vec3d p;
  double angle = 0;
  for (std::size_t i = 1; i < states_.size(); ++i) {
    const double dt = std::min(states_[i].time - states_[i - 1].time, 0.02);
    p += states_[i - 1].V_BH.linear * dt;
    angle += norm(states_[i - 1].V_BH.angular) * dt;
    EXPECT_LT(norm(states_[i].X_BH.translation - p), 1e-12);
    const Quaternion& q = states_[i].X_BH.rotation;
    EXPECT_NEAR(2 * std::atan2(norm(Vec3d{q.x, q.y, q.z}), q.w), angle, 1e-9);
  }
  EXPECT_GT(angle, 0.05);
}

TEST_F(SpacenavDevice, StandsStillWhenTheDaemonFallsSilent) {
  double z = 0;  // before the last push
  EXPECT_TRUE(comes([&](const DeviceState& state) {
    if (state.V_BH.linear.z < 0) return true;
    z = state.X_BH.translation.z;
    daemon_.motion(0, 0, 200, 0, 0, 0);
    return false;
  }));
  EXPECT_TRUE(comes([](const DeviceState& state) { return state.V_BH.linear.z == 0; }));
  EXPECT_GT(newest().X_BH.translation.z - z, -0.1 * 0.6);
  EXPECT_TRUE(newest().is_valid);
  EXPECT_TRUE(device_->status().has_value());
}

TEST_F(SpacenavDevice, IsLostWithTheDaemonAndComesBackWithIt) {
  daemon_.motion(100, 0, 0, 0, 0, 0);
  daemon_.send_bytes("half", 4);
  daemon_.hang_up();
  ASSERT_TRUE(is_lost());
  EXPECT_EQ(device_->status().error().code, Errc::io_failure);
  EXPECT_NE(device_->status().error().message.find(daemon_.path()), std::string::npos);

  states_.clear();
  start();
  daemon_.accept();
  EXPECT_TRUE(comes([this](const DeviceState& state) {
    if (state.V_BH.linear.y < 0) return true;
    daemon_.motion(0, -350, 0, 0, 0, 0);
    return false;
  }));
  EXPECT_EQ(newest().V_BH.linear.x, 0);
  EXPECT_TRUE(device_->status().has_value());
}

TEST_F(SpacenavDevice, IsLostOnGarbage) {
  const std::string garbage(1000, '\x7f');
  daemon_.send_bytes(garbage.data(), garbage.size());
  ASSERT_TRUE(is_lost());
  EXPECT_EQ(device_->status().error().code, Errc::bad_input);
}

TEST_F(SpacenavDevice, KeepsUpWithAFloodWithoutAllocating) {
  EXPECT_TRUE(comes([](const DeviceState& state) { return state.is_valid; }));
  const test::AllocationCounter counter;
  for (int i = 0; i < 20000; ++i) daemon_.motion(i % 300, 0, 0, 0, 0, 0);
  daemon_.button(3, true);
  const bool came = comes([](const DeviceState& state) { return state.buttons == 8; });
  EXPECT_TRUE(came);
  EXPECT_EQ(counter.count(), 0u);
}

}  // namespace
}  // namespace palpate
