// The VRPN client against an emulated server with a Falcon, over sockets.

#include <gtest/gtest.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <string>
#include <thread>
#include <utility>

#include "src/devices/device_kinds.h"
#include "src/devices/transport/tcp_socket.h"
#include "tests/devices/filtered_hand.h"
#include "tests/devices/tick_log.h"
#include "tests/devices/vrpn_server.h"

namespace palpate {
namespace {

using test::eventually;
using test::TickLog;
using test::VrpnServer;
using test::VrpnServerOptions;

std::string uri_of(const VrpnServer& server, const std::string& name = "Falcon0") {
  return name + "@127.0.0.1:" + std::to_string(server.port());
}

struct Bench {
  explicit Bench(const VrpnServerOptions& options = {}) : server(options) {
    server.set_target({0.01, 0.02, 0.03}, axis_angle({1, 2, 3}, 0.7));
    auto opened = open_vrpn_device(uri_of(server));
    EXPECT_TRUE(opened) << opened.error().message;
    if (opened) device = std::move(*opened);
  }
  void start() {
    const Status started = device->start(log.tick());
    ASSERT_TRUE(started) << started.error().message;
  }
  bool has_moved_along_x_at(double speed) const {
    return std::ranges::any_of(
        log.states(), [speed](const DeviceState& state) { return state.V_BH.linear.x > speed; });
  }
  void wait_until_lost(const std::string& words) { test::wait_until_lost(*device, log, words); }

  VrpnServer server;
  TickLog log;
  std::unique_ptr<HapticDevice> device;
};

TEST(VrpnDevice, SaysWhatItIs) {
  Bench bench;
  const DeviceInfo& info = bench.device->info();
  EXPECT_EQ(info.kind, "vrpn");
  EXPECT_EQ(info.name, uri_of(bench.server));
  EXPECT_EQ(info.limits.max_torque, 0);
  EXPECT_GT(info.limits.max_force, 0);
  EXPECT_LE(info.limits.max_stiffness, 300);
}

TEST(VrpnDevice, TellsPoseAndButtonsOfItsSensorOnly) {
  Bench bench;
  bench.server.buttons = 0b0101;
  bench.start();
  ASSERT_TRUE(eventually([&] { return bench.log.last().buttons == 0b0101; }));
  bench.server.buttons = 0b0100;
  ASSERT_TRUE(eventually([&] { return bench.log.last().buttons == 0b0100; }));
  const Quaternion q = axis_angle({1, 2, 3}, 0.7);
  for (const DeviceState& state : bench.log.states()) {
    if (!state.is_valid) continue;
    EXPECT_NEAR(norm(state.X_BH.translation - Vec3d{0.01, 0.02, 0.03}), 0, 1e-9);
    EXPECT_NEAR(state.X_BH.rotation.x, q.x, 1e-12);
    EXPECT_NEAR(state.X_BH.rotation.w, q.w, 1e-12);
  }
}

TEST(VrpnDevice, TheHandFeelsTheForceAndNothingAfterwards) {
  Bench bench;
  bench.log.set_force({0, 0, 2});
  bench.start();
  // At rest the spring of the hand, 200 N/m, holds the force: one centimeter.
  ASSERT_TRUE(eventually([&] {
    const DeviceState last = bench.log.last();
    return std::abs(last.X_BH.translation.z - 0.03 - 0.01) < 5e-4 && norm(last.V_BH.linear) < 1e-3;
  }));
  // A field without the force comes whenever the server was silent for a while.
  auto field = bench.server.fields().back();
  EXPECT_TRUE(eventually([&] {
    field = bench.server.fields().back();
    return std::abs(field[2] - 0.04) < 2e-3 && field[5] == 2;
  })) << "the origin is where the handle is, and the force is felt there";
  for (std::size_t i = 6; i < 15; ++i) EXPECT_EQ(field[i], 0) << "a force alone has no stiffness";
  EXPECT_GT(field[15], 0);
  bench.device->stop();
  ASSERT_TRUE(eventually([&] { return bench.server.fields().back()[15] == 0; }));
  EXPECT_EQ(bench.server.fields().back()[5], 0);
  EXPECT_EQ(bench.server.num_bad_messages(), 0);
  EXPECT_NE(bench.server.names(), std::vector<std::string>{});
}

/// The largest velocity of the log while a force begins to push the hand.
double fastest(const VrpnServerOptions& options) {
  Bench bench(options);
  bench.start();
  EXPECT_TRUE(eventually([&] { return bench.log.num_valid() > 50; }));
  double speed = 0;
  // Again if the computer stood still during the motion.
  for (int turn = 0; turn < 20 && speed < 0.03; ++turn) {
    bench.log.set_force({0, 0, 4});
    EXPECT_TRUE(eventually([&] { return bench.log.last().X_BH.translation.z > 0.045; }));
    for (const DeviceState& state : bench.log.states())
      speed = std::max(speed, state.V_BH.linear.z);
    bench.log.set_force({});
    EXPECT_TRUE(eventually([&] { return bench.log.last().X_BH.translation.z < 0.033; }));
  }
  return speed;
}

TEST(VrpnDevice, VelocitiesHaveTheRightSizeWhateverTheServerCallsThem) {
  VrpnServerOptions plain, falcon, silent;
  falcon.velocity_unit = 1e-6;
  silent.reports_velocity = false;
  for (const VrpnServerOptions& options : {plain, falcon, silent}) {
    // The hand comes to 2 cm from rest: roughly 0.3 m/s in between.
    const double speed = fastest(options);
    EXPECT_GT(speed, 0.03);
    EXPECT_LT(speed, 3);
  }
}

TEST(VrpnDevice, AVelocityThatIsNoLongerReportedIsOver) {
  Bench bench;
  bench.start();
  ASSERT_TRUE(eventually([&] { return bench.log.num_valid() > 50; }));
  // Motion, from which the device learns that reported velocities are meant as such, then one
  // velocity along x and no more: again if a busy client or server was late for it.
  double force = 0;
  EXPECT_TRUE(eventually([&] {
    force = 4 - force;
    bench.log.set_force({0, 0, force});
    std::this_thread::sleep_for(std::chrono::milliseconds(200));
    bench.server.ends_velocities = true;
    std::this_thread::sleep_for(std::chrono::milliseconds(20));
    bench.server.ends_velocities = bench.has_moved_along_x_at(0.5);
    return bench.server.ends_velocities.load();
  }));
  EXPECT_TRUE(eventually([&] { return norm(bench.log.last().V_BH.linear) < 1e-3; }));
}

TEST(VrpnDevice, VelocitiesNeedNoClockOfTheServer) {
  VrpnServerOptions silent;
  silent.reports_velocity = false;
  Bench bench(silent);
  bench.server.has_no_clock = true;
  bench.start();
  ASSERT_TRUE(eventually([&] { return bench.log.num_valid() > 100; }));
  // To and fro: who stands still for as long as one motion takes knows nothing of its velocity.
  double x = 0.01;
  EXPECT_TRUE(eventually([&] {
    x = 0.04 - x;
    bench.server.set_target({x, 0.02, 0.03});
    std::this_thread::sleep_for(std::chrono::milliseconds(100));
    return bench.has_moved_along_x_at(0.01);
  }));
}

TEST(VrpnDevice, PosesThatCannotBeAreNoPoses) {
  Bench bench;
  bench.start();
  ASSERT_TRUE(eventually([&] { return bench.log.num_valid() > 20; }));
  bench.server.is_wild = true;
  EXPECT_TRUE(eventually([&] { return bench.log.size() > 20 && !bench.log.last().is_valid; }));
  bench.server.is_wild = false;
  EXPECT_TRUE(eventually([&] { return bench.log.last().is_valid; }));
  for (const DeviceState& state : bench.log.states()) {
    EXPECT_LT(norm(state.X_BH.translation), 1);
    EXPECT_LT(norm(state.V_BH.linear), 10);
    EXPECT_TRUE(!state.is_valid || std::abs(state.X_BH.rotation.x) > 0.01);  // it is turned
  }
  bench.server.is_wild = true;
  bench.wait_until_lost("no position for 1 s");
}

TEST(VrpnDevice, MessagesInPiecesAreTheSame) {
  Bench bench;
  bench.server.dribbles = true;
  bench.start();
  EXPECT_TRUE(eventually([&] { return bench.log.num_valid() > 100; }));
}

TEST(VrpnDevice, AServerThatStandsStillForAMomentGoesOn) {
  Bench bench;
  test::expect_to_fade_and_return(*bench.device,
                                  [&](bool is_still) { bench.server.is_silent = is_still; });
}

// Nobody knows where the hand is, and the last pose is no state.
TEST(VrpnDevice, APoseIsAStateForATenthOfASecondAtMost) {
  Bench bench;
  bench.server.trembles = true;
  bench.start();
  ASSERT_TRUE(eventually([&] { return bench.log.num_valid() > 20; }));
  bench.server.is_silent = true;
  EXPECT_TRUE(eventually([&] { return !bench.device->status(); }));
  double came = 0, oldest = 0;
  Vec3d last;
  for (const DeviceState& state : bench.log.states()) {
    if (!(std::exchange(last, state.X_BH.translation) == state.X_BH.translation)) came = state.time;
    if (state.is_valid) oldest = std::max(oldest, state.time - came);
  }
  EXPECT_LE(oldest, 0.1);
  EXPECT_GT(bench.log.last().time, came + 0.1);
}

TEST(VrpnDevice, EveryFaultEndsInASentence) {
  struct Fault {
    std::atomic<bool> VrpnServer::*which;
    const char* words;
  };
  for (const Fault& fault : {Fault{&VrpnServer::is_silent, "no position for 1 s"},
                             Fault{&VrpnServer::sends_garbage, "not VRPN"},
                             Fault{&VrpnServer::sends_huge_length, "not VRPN"},
                             Fault{&VrpnServer::stops_in_message, "no position for 1 s"},
                             Fault{&VrpnServer::closes, "ended the connection"}}) {
    Bench bench;
    bench.log.set_force({0, 0, 1});
    bench.start();
    ASSERT_TRUE(eventually([&] { return bench.log.num_valid() > 20; }));
    bench.server.*fault.which = true;
    bench.wait_until_lost(fault.words);
  }
}

TEST(VrpnDevice, ErrorsOfTheForceDeviceEndTheRun) {
  Bench bench;
  bench.start();
  ASSERT_TRUE(eventually([&] { return bench.log.num_valid() > 20; }));
  bench.server.force_error = 2;
  bench.wait_until_lost("motor is too hot");
}

TEST(VrpnDevice, StopsAndStartsAgain) {
  Bench bench;
  for (int i = 0; i < 3; ++i) {
    bench.start();
    const std::size_t before = bench.log.num_valid();
    ASSERT_TRUE(eventually([&] { return bench.log.num_valid() > before + 20; }));
    bench.device->stop();
  }
  bench.start();
  bench.server.is_silent = true;
  bench.device.reset();  // must come to an end
}

TEST(VrpnDevice, ForcesBeyondTheLimitsAreCut) {
  Bench bench;
  bench.log.set_force({0, 0, 1e6});
  bench.start();
  ASSERT_TRUE(eventually([&] { return bench.server.fields().size() > 20; }));
  bench.log.set_force({0, 0, std::nan("")});
  for (const auto& field : bench.server.fields())
    EXPECT_LE(field[5], bench.device->info().limits.max_force * 1.000001);
  EXPECT_TRUE(eventually([&] { return bench.server.fields().back()[5] == 0; }));
}

TEST(VrpnDevice, ErrorsNameWhatWasTriedAndWhatToDo) {
  EXPECT_EQ(open_vrpn_device("").error().code, Errc::invalid_argument);
  EXPECT_EQ(open_vrpn_device("Phantom0").error().code, Errc::invalid_argument);
  EXPECT_EQ(open_vrpn_device("@host").error().code, Errc::invalid_argument);
  EXPECT_EQ(open_vrpn_device("a@host:99999").error().code, Errc::invalid_argument);

  const auto nobody = open_vrpn_device("Phantom0@127.0.0.1:1");
  ASSERT_FALSE(nobody);
  EXPECT_NE(nobody.error().message.find("127.0.0.1:1"), std::string::npos);
  EXPECT_NE(nobody.error().message.find("start vrpn_server"), std::string::npos);

  const VrpnServer server;
  const auto wrong_name = open_vrpn_device(uri_of(server, "Phantom0"));
  ASSERT_FALSE(wrong_name);
  EXPECT_NE(wrong_name.error().message.find("Falcon0"), std::string::npos)
      << wrong_name.error().message;

  VrpnServerOptions old;
  old.cookie = "vrpn: ver. 06.04  0";
  const VrpnServer old_server(old);
  const auto too_old = open_vrpn_device(uri_of(old_server));
  ASSERT_FALSE(too_old);
  EXPECT_NE(too_old.error().message.find("version 7"), std::string::npos);

  VrpnServer still;
  still.is_silent = true;
  const auto uncalibrated = open_vrpn_device(uri_of(still));
  ASSERT_FALSE(uncalibrated);
  EXPECT_NE(uncalibrated.error().message.find("calibrate"), std::string::npos);
}

TEST(VrpnDevice, IsFound) {
  const VrpnServer server;
  FoundDevice there;
  EXPECT_TRUE(eventually([&] {  // it does not wait long
    there = find_vrpn_device_at({"127.0.0.1", server.port()});
    return there.is_usable;
  })) << there.what;
  EXPECT_NE(there.what.find("Falcon0"), std::string::npos);
  EXPECT_EQ(there.uri, "vrpn:" + uri_of(server));
  const FoundDevice nowhere = find_vrpn_device_at({"127.0.0.1", 1});
  EXPECT_FALSE(nowhere.is_usable);
  EXPECT_NE(nowhere.what.find("127.0.0.1:1"), std::string::npos);
  EXPECT_FALSE(nowhere.hint.empty());
}

}  // namespace
}  // namespace palpate
