// The client of Haply's service against an emulated one, over sockets.

#include "src/devices/haply/haply_device.h"

#include <gtest/gtest.h>

#include <chrono>
#include <string>
#include <thread>
#include <utility>

#include "src/devices/device_kinds.h"
#include "tests/devices/filtered_hand.h"
#include "tests/devices/haply_service.h"
#include "tests/devices/tick_log.h"

namespace palpate {
namespace {

using test::eventually;
using test::HaplyService;
using test::HaplyServiceOptions;
using test::TickLog;

HaplyAddress address_of(const HaplyService& service) {
  return {{"127.0.0.1", service.port()}, service.event_port()};
}

/// A service, its device and the log of its states.
struct Bench {
  explicit Bench(const HaplyServiceOptions& options = {}) : service(options) {
    service.set_target({0.01, -0.12, 0.15});
    auto opened = open_haply_device_at(address_of(service));
    EXPECT_TRUE(opened) << opened.error().message;
    if (opened) device = std::move(*opened);
  }
  void start() {
    const Status started = device->start(log.tick());
    ASSERT_TRUE(started) << started.error().message;
  }
  void wait_until_lost(const std::string& words) { test::wait_until_lost(*device, log, words); }

  HaplyService service;
  TickLog log;
  std::unique_ptr<HapticDevice> device;
};

TEST(HaplyDevice, SaysWhatItIs) {
  Bench bench;
  const DeviceInfo& info = bench.device->info();
  EXPECT_EQ(info.kind, "haply");
  EXPECT_NE(info.name.find("Inverse3 049D with verse_grip 61548"), std::string::npos) << info.name;
  EXPECT_NE(info.name.find("3.5"), std::string::npos) << info.name;
  EXPECT_GT(info.limits.max_force, 0);
  EXPECT_EQ(info.limits.max_torque, 0);
  EXPECT_TRUE(info.senses_orientation);
  EXPECT_EQ(info.num_buttons, 1);
  EXPECT_TRUE(bench.service.messages().empty()) << "opening asks for nothing";
}

TEST(HaplyDevice, ProbesBeforeTheFirstTickThenSendsEveryForce) {
  Bench bench;
  bench.log.set_force({0.25, -0.5, 1});
  bench.start();
  ASSERT_TRUE(eventually([&] { return bench.log.num_valid() > 50; }));
  bench.device->stop();
  EXPECT_TRUE(eventually([&] { return bench.service.last_force() == Vec3d{}; }))
      << "the last message of all takes the force away";
  const auto messages = bench.service.messages();
  EXPECT_NE(messages[0].find("profile"), std::string::npos) << messages[0];
  EXPECT_NE(messages[0].find("probe_position"), std::string::npos) << messages[0];
  EXPECT_EQ(messages[0].find("set_cursor_force"), std::string::npos);
  EXPECT_EQ(messages[1].find("session"), std::string::npos) << messages[1];
  EXPECT_NE(messages[2].find("vector"), std::string::npos) << messages[2];
  EXPECT_NE(messages[2].find("probe_orientation"), std::string::npos) << messages[2];
  const auto forces = bench.service.forces();
  ASSERT_FALSE(forces.empty());
  EXPECT_EQ(forces.front(), (Vec3d{0.25, -1, -0.5}));  // its y is away from the hand, its z up
  EXPECT_TRUE(bench.device->status());
}

TEST(HaplyDevice, TheHandFeelsTheForce) {
  HaplyServiceOptions options;
  options.force_timeout = 5;  // of a client that may be late
  Bench bench(options);
  bench.service.set_target({0.02, -0.15, 0.15});
  bench.start();
  ASSERT_TRUE(eventually([&] { return bench.log.last().is_valid; }));
  const double y = bench.log.last().X_BH.translation.y;
  // At rest the force is held by the hand's spring of 100 N/m: one centimeter, upwards and
  // downwards.
  bool has_moved = false;
  for (int turn = 0; turn < 100 && !has_moved; ++turn) {
    const double force = turn % 2 == 0 ? 1 : -1;
    bench.log.set_force({0, force, 0});
    ASSERT_TRUE(eventually([&] {
      const Vec3d hand = bench.service.hand_position();
      return norm(hand - Vec3d{0.02, -0.15, 0.15 + 0.01 * force}) < 0.002 &&
             std::abs(bench.log.last().X_BH.translation.y - y - 0.01 * force) < 0.002;
    })) << force
        << " N";
    // A computer that stands still during the whole way sees no velocity: there and back again.
    for (const DeviceState& state : bench.log.states()) has_moved |= state.V_BH.linear.y > 0.01;
  }
  EXPECT_TRUE(has_moved) << "velocities come with the states";
}

// The middle of the workspace, seen from the device's base, is that of the maker's own example.
TEST(HaplyDevice, TheOriginIsTheMiddleOfTheWorkspace) {
  const Vec3d off{0.01, 0.02, 0.03};  // to the right, away from the hand, up
  for (const std::string preset : {"defaults", "arm_front", "", "arm_front_centered", "custom"}) {
    HaplyServiceOptions options;
    options.preset = preset;
    Bench bench(options);
    const bool is_base = preset.empty() || preset == "defaults" || preset == "arm_front";
    bench.service.set_target(is_base ? Vec3d{0.0186, -0.153, 0.151} + off : off);
    bench.start();
    ASSERT_TRUE(eventually([&] { return bench.log.num_valid() > 5; }));
    EXPECT_LT(norm(bench.log.last().X_BH.translation - Vec3d{0.01, 0.03, -0.02}), 1e-9) << preset;
  }
}

TEST(HaplyDevice, EveryGrip) {
  for (const std::string grip : {"verse_grip", "wireless_verse_grip", "custom_verse_grip", ""}) {
    HaplyServiceOptions options;
    options.grip = grip;
    Bench bench(options);
    const Quaternion turned = axis_angle({1, 2, 3}, 0.7);
    bench.service.set_orientation(turned);
    bench.service.buttons = 0b1101;
    bench.start();
    ASSERT_TRUE(eventually([&] { return bench.log.num_valid() > 5; }));
    const DeviceState state = bench.log.last();
    EXPECT_EQ(bench.device->info().senses_orientation, !grip.empty());
    // The same turn about the same axis: the service's y is away from the hand, its z up.
    const Quaternion expected = grip.empty() ? Quaternion{} : axis_angle({1, 3, -2}, 0.7);
    EXPECT_NEAR(state.X_BH.rotation.x, expected.x, 1e-12) << grip;
    EXPECT_NEAR(state.X_BH.rotation.y, expected.y, 1e-12) << grip;
    EXPECT_NEAR(state.X_BH.rotation.z, expected.z, 1e-12) << grip;
    EXPECT_NEAR(state.X_BH.rotation.w, expected.w, 1e-12) << grip;
    EXPECT_EQ(state.buttons, grip.empty() ? 0u : (grip == "verse_grip" ? 1u : 0b1101u)) << grip;
  }
}

TEST(HaplyDevice, OlderServicesGetOlderWords) {
  HaplyServiceOptions options;
  options.version = "3.4.1";
  options.accepts_vector = false;
  Bench bench(options);
  bench.log.set_force({0, 1, 0});
  bench.start();
  ASSERT_TRUE(eventually([&] { return bench.log.num_valid() > 20; }));
  EXPECT_EQ(bench.service.forces().front(), (Vec3d{0, 0, 1}));
}

TEST(HaplyDevice, ChangesItsWordsWhenNotHeardAndBeginsSoftly) {
  HaplyServiceOptions options;
  options.version = "";  // cannot be requested
  options.accepts_vector = false;
  Bench bench(options);
  bench.log.set_force({0, 1, 0});
  bench.start();
  ASSERT_TRUE(eventually([&] { return bench.service.last_force().z > 0.999; }));
  double largest_step = 0;
  const auto forces = bench.service.forces();
  for (std::size_t i = 1; i < forces.size(); ++i)
    largest_step = std::max(largest_step, forces[i].z - forces[i - 1].z);
  EXPECT_LT(largest_step, 0.01);
  EXPECT_TRUE(bench.device->status());
}

// The states tell the safety filter that meanwhile the hand may have felt nothing.
TEST(HaplyDevice, HasNoForceUntilItsNewWordsHaveAllOfIt) {
  HaplyServiceOptions options;
  options.version = "";
  options.accepts_vector = false;
  Bench bench(options);
  bench.log.set_force({0, 1, 0});
  bench.start();
  ASSERT_TRUE(eventually([&] { return bench.service.last_force().z > 0.999; }));
  ASSERT_TRUE(eventually([&] { return bench.log.last().has_force; }));
  int num_without = 0, num_changes = 0;
  bool has_force = true;
  for (const DeviceState& state : bench.log.states()) {
    num_without += state.is_valid && !state.has_force;
    num_changes += std::exchange(has_force, state.has_force) != state.has_force;
  }
  EXPECT_GE(num_without, 199);
  EXPECT_EQ(num_changes, 2);
}

// One round trip of more than a tick: after a fault the force comes back all the same.
TEST(HaplyDevice, TheForceReturnsFromASlowService) {
  Bench bench;
  test::expect_to_fade_and_return(
      *bench.device, [&](bool is_still) { bench.service.faults.reply_delay = is_still ? 300 : 2; });
}

TEST(HaplyDevice, ADeafServiceEndsTheRun) {
  HaplyServiceOptions options;
  options.accepts_vector = options.accepts_values = false;
  Bench bench(options);
  bench.log.set_force({0, 1, 0});
  bench.start();
  bench.wait_until_lost("does not take the forces");
}

TEST(HaplyDevice, AServiceWithoutEchoesIsTrusted) {
  HaplyServiceOptions options;
  options.echoes_forces = false;
  Bench bench(options);
  bench.log.set_force({0, 1, 0});
  bench.start();
  ASSERT_TRUE(eventually([&] { return bench.log.num_valid() > 500; }));
  EXPECT_TRUE(bench.device->status());
  EXPECT_NE(bench.service.messages().back().find("vector"), std::string::npos);
}

TEST(HaplyDevice, MissingFieldsAreTheIdentityOrAsTheyWere) {
  Bench bench;
  bench.service.set_target({0, 0, 0.15});
  bench.service.set_orientation({0, 0, 1, 0});
  bench.start();
  ASSERT_TRUE(eventually([&] { return bench.log.num_valid() > 5; }));
  bench.service.faults.leaves_fields_out = true;
  const std::size_t before = bench.log.size();
  ASSERT_TRUE(eventually([&] { return bench.log.size() > before + 20; }));
  const DeviceState state = bench.log.last();
  EXPECT_TRUE(bench.device->status());
  EXPECT_NEAR(norm(state.X_BH.translation - Vec3d{-0.0186, -0.001, -0.153}), 0, 1e-3);
  EXPECT_EQ(state.V_BH.linear, Vec3d{});
  EXPECT_EQ(state.X_BH.rotation, (Quaternion{0, 1, 0, 0})) << "the grip was not mentioned";
}

TEST(HaplyDevice, APositionThatNoDeviceReachesIsNoState) {
  Bench bench;
  bench.start();
  ASSERT_TRUE(eventually([&] { return bench.log.num_valid() > 5; }));
  bench.service.set_target({1e308, 0, 0});
  bench.wait_until_lost("hold no position");
  for (const DeviceState& state : bench.log.states()) EXPECT_LT(norm(state.X_BH.translation), 1);
}

TEST(HaplyDevice, LateAnswersAreTicksWithoutAState) {
  HaplyServiceOptions options;
  options.force_timeout = 5;  // it takes the forces, however late
  Bench bench(options);
  bench.log.set_force({0, 0, 1});
  bench.start();
  bench.service.faults.reply_delay = 20;
  ASSERT_TRUE(eventually([&] { return bench.log.size() > 300; }));
  bench.service.faults.reply_delay = 0;
  const std::size_t num_valid = bench.log.num_valid();
  EXPECT_GT(num_valid, 0u);
  EXPECT_LT(num_valid, bench.log.size());
  EXPECT_TRUE(eventually([&] { return bench.log.num_valid() > num_valid + 100; })) << "it recovers";
  EXPECT_TRUE(bench.device->status());
}

TEST(HaplyDevice, PiecesAndPingsAreNothingSpecial) {
  Bench bench;
  bench.service.faults.fragments_messages = true;
  bench.service.faults.pings = true;
  bench.start();
  EXPECT_TRUE(eventually([&] { return bench.log.num_valid() > 100; }));
  EXPECT_TRUE(bench.device->status());
}

TEST(HaplyDevice, AServiceThatStandsStillForAMomentGoesOn) {
  Bench bench;
  test::expect_to_fade_and_return(
      *bench.device, [&](bool is_still) { bench.service.faults.reply_delay = is_still ? 300 : 0; });
}

TEST(HaplyDevice, EveryFaultEndsInASentence) {
  struct Fault {
    std::atomic<bool> HaplyService::Faults::*which;
    bool value;
    const char* words;
  };
  for (const Fault& fault :
       {Fault{&HaplyService::Faults::is_silent, true, "has not answered"},
        Fault{&HaplyService::Faults::says_garbage, true, "cannot be read"},
        Fault{&HaplyService::Faults::has_vanished, true, "no longer connected"},
        Fault{&HaplyService::Faults::is_calibrated, false, "not calibrated"},
        Fault{&HaplyService::Faults::is_grip_connected, false, "grip is not connected"},
        Fault{&HaplyService::Faults::closes_in_message, true, "closed the connection"}}) {
    HaplyServiceOptions options;
    options.grip = "wireless_verse_grip";
    Bench bench(options);
    bench.log.set_force({0, 0, 1});
    bench.start();
    ASSERT_TRUE(eventually([&] { return bench.log.num_valid() > 20; }));
    bench.service.faults.*fault.which = fault.value;
    bench.wait_until_lost(fault.words);
  }
}

TEST(HaplyDevice, FaultsBeforeTheFirstTickAreErrorsOfStart) {
  Bench bench;
  bench.service.faults.is_calibrated = false;
  const Status status = bench.device->start(bench.log.tick());
  ASSERT_FALSE(status);
  EXPECT_NE(status.error().message.find("not calibrated"), std::string::npos)
      << status.error().message;
  EXPECT_EQ(bench.log.size(), 0u);
  bench.service.faults.is_calibrated = true;
  bench.start();
  EXPECT_TRUE(eventually([&] { return bench.log.num_valid() > 5; }));
}

TEST(HaplyDevice, EventsOfThisDeviceCount) {
  Bench bench;
  bench.start();
  bench.service.push_event("no json at all");
  bench.service.push_event(R"({"name":"device-battery-low","data":{"device_id":"049D"}})");
  bench.service.push_event(
      R"({"name":"device-safety-triggered","data":{"device_id":"other","safety_type":"ebrake_triggered"}})");
  ASSERT_TRUE(eventually([&] { return bench.log.num_valid() > 100; }));
  EXPECT_TRUE(bench.device->status());
  bench.service.push_event(
      R"({"name":"device-safety-triggered","category":"device","level":"warning","data":)"
      R"({"device_family":"inverse","device_id":"049D","safety_type":"ebrake_triggered"}})");
  bench.wait_until_lost("emergency brake");
  EXPECT_TRUE(eventually([&] { return bench.service.last_force() == Vec3d{}; }));
}

TEST(HaplyDevice, StopsAndStartsAgain) {
  HaplyServiceOptions options;
  options.has_events = false;
  Bench bench(options);
  for (int i = 0; i < 3; ++i) {
    bench.log.set_force({0, 0, 1});
    bench.start();
    const std::size_t before = bench.log.num_valid();
    ASSERT_TRUE(eventually([&] { return bench.log.num_valid() > before + 20; }));
    bench.device->stop();
    EXPECT_TRUE(eventually([&] { return bench.service.last_force() == Vec3d{}; }));
  }
  bench.start();
  bench.service.faults.is_silent = true;
  bench.device.reset();  // must come to an end
}

TEST(HaplyDevice, ForcesBeyondTheLimitsAreCut) {
  Bench bench;
  bench.log.set_force({0, 0, 1e6});
  bench.start();
  ASSERT_TRUE(eventually([&] { return norm(bench.service.last_force()) > 1; }));
  bench.log.set_force({0, 0, std::nan("")});
  for (const Vec3d& force : bench.service.forces())
    EXPECT_LE(norm(force), bench.device->info().limits.max_force * 1.000001);
  EXPECT_TRUE(eventually([&] { return bench.service.last_force() == Vec3d{}; }));
}

TEST(HaplyDevice, ErrorsNameWhatWasTriedAndWhatToDo) {
  const auto nobody = open_haply_device("ws://127.0.0.1:1");
  ASSERT_FALSE(nobody);
  EXPECT_NE(nobody.error().message.find("127.0.0.1:1"), std::string::npos);
  EXPECT_NE(nobody.error().message.find("start Haply's Inverse Service"), std::string::npos);
  EXPECT_EQ(open_haply_device("ws://host:port").error().code, Errc::invalid_argument);

  HaplyServiceOptions old;
  old.version = R"({"version":"2.1.1"})";
  const HaplyService old_service(old);
  const auto too_old = open_haply_device_at(address_of(old_service));
  ASSERT_FALSE(too_old);
  EXPECT_NE(too_old.error().message.find("update it"), std::string::npos);

  HaplyServiceOptions empty;
  empty.has_arm = false;
  const HaplyService empty_service(empty);
  const auto no_arm = open_haply_device_at(address_of(empty_service));
  ASSERT_FALSE(no_arm);
  EXPECT_NE(no_arm.error().message.find("no Inverse3"), std::string::npos);
  EXPECT_FALSE(find_haply_device_at(address_of(empty_service)).is_usable);
}

TEST(HaplyDevice, IsFound) {
  const HaplyService service;
  FoundDevice there;
  EXPECT_TRUE(eventually([&] {  // it does not wait long
    there = find_haply_device_at(address_of(service));
    return there.is_usable;
  })) << there.what;
  EXPECT_EQ(there.uri, "haply:ws://127.0.0.1:" + std::to_string(service.port()));
  EXPECT_NE(there.what.find("Inverse3 049D"), std::string::npos);
  const FoundDevice nowhere = find_haply_device_at({{"127.0.0.1", 1}, 1});
  EXPECT_FALSE(nowhere.is_usable);
  EXPECT_NE(nowhere.what.find("127.0.0.1:1"), std::string::npos);
  EXPECT_FALSE(nowhere.hint.empty());
}

}  // namespace
}  // namespace palpate
