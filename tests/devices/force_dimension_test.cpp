// Against a fake SDK: a shared library with the functions of the real one.
#include <gtest/gtest.h>

#include <atomic>
#include <cmath>
#include <cstdlib>
#include <limits>
#include <memory>

#include "src/core/internal/bounded_call.h"
#include "src/devices/device_kinds.h"
#include "tests/devices/fake_dhd.h"
#include "tests/devices/fake_sdk.h"
#include "tests/devices/filtered_hand.h"
#include "tests/test_util/allocation_counter.h"

namespace palpate {
namespace {

using test::contains;
using test::eventually;

class ForceDimension : public testing::Test {
 protected:
  void SetUp() override {
    setenv("FDSDK", FAKE_SDK_FOLDER "/whole", 1);
    unsetenv("FORCEDIM_SDK");
    setenv("HOME", "/nonexistent", 1);
    fake_.reset();
  }

  static std::unique_ptr<HapticDevice> open(std::string_view address = "") {
    auto device = open_force_dimension_device(address);
    EXPECT_TRUE(device.has_value()) << (device ? "" : device.error().message);
    return device ? std::move(*device) : nullptr;
  }
  static Error open_error(std::string_view address = "") {
    const auto device = open_force_dimension_device(address);
    EXPECT_FALSE(device.has_value());
    return device ? Error{} : device.error();
  }
  /// One that has been started and gets `F`.
  std::unique_ptr<HapticDevice> running(const Wrench& F) {
    auto device = open();
    EXPECT_TRUE(device->start([F](const DeviceState&) { return F; }).has_value());
    EXPECT_TRUE(eventually([&] { return fake_.wrench[0] != 0; }));
    return device;
  }
  void expect_no_force() {
    for (const auto& part : fake_.wrench) EXPECT_EQ(part, 0);
    EXPECT_FALSE(fake_.is_force_enabled);
  }

  test::FakeDhd& fake_ = test::fake_control<test::FakeDhd>(
      FAKE_SDK_FOLDER "/whole/lib/release/" FAKE_SDK_MACHINE "/libdrd.so", "fake_dhd");
  const Wrench kPush{{1, 2, 3}, {0.01, 0.02, 0.03}};
};

TEST_F(ForceDimension, WithoutAnSdkEveryPathIsNamed) {
  setenv("FDSDK", "/nonexistent/sdk", 1);
  const auto device = open_force_dimension_device("");
  if (device.has_value()) GTEST_SKIP() << "SKIPPED: there is an SDK on this machine";
  EXPECT_EQ(device.error().code, Errc::not_found);
  for (const char* part :
       {"/nonexistent/sdk/lib/release/" FAKE_SDK_MACHINE "/libdrd.so",
        "/nonexistent/.local/lib/libdrd.so", "/usr/local/lib/libdrd.so", "set FDSDK"})
    EXPECT_TRUE(contains(device.error().message, part)) << device.error().message;
  const FoundDevice found = find_force_dimension_device();
  EXPECT_FALSE(found.is_usable);
  EXPECT_TRUE(contains(found.what, "/usr/local/lib/libdrd.so")) << found.what;
  EXPECT_TRUE(contains(found.hint, "udev")) << found.hint;
}

TEST_F(ForceDimension, AFileThatIsNoLibraryIsToldWithWhatTheLoaderSaid) {
  setenv("FDSDK", FAKE_SDK_FOLDER "/broken", 1);
  const auto device = open_force_dimension_device("");
  if (device.has_value()) GTEST_SKIP() << "SKIPPED: there is an SDK on this machine";
  EXPECT_TRUE(
      contains(device.error().message, "broken/lib/release/" FAKE_SDK_MACHINE "/libdrd.so ("))
      << device.error().message;
}

TEST_F(ForceDimension, MissingFunctionsAreNamed) {
  setenv("FDSDK", FAKE_SDK_FOLDER "/incomplete", 1);
  const Error error = open_error();
  EXPECT_EQ(error.code, Errc::unavailable);
  EXPECT_TRUE(contains(error.message, "lacks drdIsInitialized:")) << error.message;
}

TEST_F(ForceDimension, AnOldSdkIsRefused) {
  fake_.version_minor = 6;
  const Error error = open_error();
  EXPECT_EQ(error.code, Errc::unavailable);
  EXPECT_TRUE(contains(error.message, "3.6.1.99, which is too old")) << error.message;
}

TEST_F(ForceDimension, FindingOpensNothing) {
  fake_.num_devices = 2;
  FoundDevice found = find_force_dimension_device();
  EXPECT_TRUE(found.is_usable);
  EXPECT_EQ(found.uri, "forcedimension");
  EXPECT_TRUE(contains(found.what, "2 devices, 1 free")) << found.what;
  EXPECT_EQ(found.hint, "");
  fake_.num_available = 0;
  found = find_force_dimension_device();
  EXPECT_FALSE(found.is_usable);
  EXPECT_EQ(found.hint, "end the program that uses it");
  fake_.num_devices = 0;
  found = find_force_dimension_device();
  EXPECT_FALSE(found.is_usable);
  EXPECT_TRUE(contains(found.hint, "udev")) << found.hint;
  fake_.num_devices = -1;
  EXPECT_FALSE(find_force_dimension_device().is_usable);
  EXPECT_EQ(fake_.last_opened, -1);
  EXPECT_EQ(fake_.num_writes, 0);
  EXPECT_EQ(fake_.num_forbidden, 0);
}

TEST_F(ForceDimension, NoDevice) {
  fake_.num_devices = 0;
  const Error error = open_error();
  EXPECT_EQ(error.code, Errc::not_found);
  EXPECT_TRUE(contains(error.message, "sees 0 devices")) << error.message;
}

TEST_F(ForceDimension, SeveralDevices) {
  fake_.num_devices = 3;
  open("2");
  EXPECT_EQ(fake_.last_opened, 2);
  fake_.first_free = 1;
  open();
  EXPECT_EQ(fake_.last_opened, 1);
  EXPECT_EQ(fake_.num_open, 0);
  EXPECT_EQ(open_error("3").code, Errc::not_found);
  EXPECT_EQ(open_error("0").code, Errc::io_failure);
  for (const char* wrong : {"-1", "x", "1x", "999999999999", "127"})
    EXPECT_EQ(open_error(wrong).code, Errc::invalid_argument) << wrong;
}

TEST_F(ForceDimension, ADeviceThatIsNotInitializedIsNotMoved) {
  fake_.is_initialized = false;
  const Error error = open_error();
  EXPECT_EQ(error.code, Errc::unavailable);
  EXPECT_TRUE(contains(error.message, "HapticInit")) << error.message;
  EXPECT_EQ(fake_.num_forbidden, 0);
  EXPECT_EQ(fake_.num_writes, 0);
  EXPECT_EQ(fake_.num_open, 0);
}

TEST_F(ForceDimension, LimitsFollowTheTypeAndTheWrist) {
  EXPECT_EQ(open()->info().limits.max_force, 12);
  EXPECT_EQ(open()->info().limits.max_torque, 0.2);
  EXPECT_TRUE(open()->info().senses_orientation);
  fake_.has_active_wrist = false;
  EXPECT_EQ(open()->info().limits.max_torque, 0);
  fake_.has_wrist = false;
  EXPECT_FALSE(open()->info().senses_orientation);
  fake_.system_type = 63;
  EXPECT_EQ(open()->info().limits.max_force, 20);
  fake_.system_type = 12345;  // unknown: the weakest
  EXPECT_EQ(open()->info().limits.max_force, 8);
}

TEST_F(ForceDimension, StateAndWrench) {
  const Quaternion turn = axis_angle({1, -2, 0.5}, 2.5);
  const Mat3d R = rotation_matrix(turn);
  for (int i = 0; i < 9; ++i) fake_.rotation[i] = R.m[i / 3][i % 3];
  for (int i = 0; i < 3; ++i) {
    fake_.position[i] = 0.01 * (i + 1);
    fake_.velocity[i] = 0.1 * (i + 1);
    fake_.angular_velocity[i] = i + 1;
  }
  fake_.buttons = 5;
  fake_.read_result = 1;   // DHD_TIMEGUARD is no error
  fake_.write_result = 2;  // nor is DHD_MOTOR_SATURATED
  auto device = open();
  EXPECT_EQ(fake_.num_writes, 0);
  EXPECT_FALSE(fake_.is_force_enabled);
  DeviceState seen;
  std::atomic<int> num_ticks = 0;
  std::atomic<std::size_t> allocations_before = 0, allocations_after = 0;
  ASSERT_TRUE(device
                  ->start([&](const DeviceState& state) {
                    if (num_ticks == 5) allocations_before = test::num_allocations();
                    if (num_ticks == 150) allocations_after = test::num_allocations();
                    if (num_ticks < 150) seen = state;
                    ++num_ticks;
                    return kPush;
                  })
                  .has_value());
  ASSERT_TRUE(eventually([&] { return num_ticks > 200; }));
  EXPECT_EQ(allocations_before, allocations_after);
  EXPECT_TRUE(device->status().has_value());
  EXPECT_TRUE(fake_.is_force_enabled);
  EXPECT_EQ(fake_.gravity, 1);
  EXPECT_EQ(fake_.max_force, 12);
  EXPECT_EQ(fake_.max_torque, 0.2);
  const double expected[] = {3, 1, 2, 0.03, 0.01, 0.02, 0};
  for (int i = 0; i < 7; ++i) EXPECT_EQ(fake_.wrench[i], expected[i]) << i;
  device->stop();
  expect_no_force();
  EXPECT_TRUE(seen.is_valid);
  EXPECT_EQ(seen.X_BH.translation, (Vec3d{0.02, 0.03, 0.01}));
  const Quaternion& q = seen.X_BH.rotation;
  EXPECT_NEAR(std::abs(q.x * turn.y + q.y * turn.z + q.z * turn.x + q.w * turn.w), 1, 1e-12);
  EXPECT_EQ(seen.V_BH.linear, (Vec3d{0.2, 0.1 * 3, 0.1}));
  EXPECT_EQ(seen.V_BH.angular, (Vec3d{2, 3, 1}));
  EXPECT_EQ(seen.buttons, 5u);

  // Once more, and gone with the device.
  num_ticks = 1000;
  ASSERT_TRUE(device->start([&](const DeviceState&) { return ++num_ticks, kPush; }).has_value());
  EXPECT_TRUE(eventually([&] { return num_ticks > 1050; }));
  device.reset();
  expect_no_force();
  EXPECT_EQ(fake_.num_open, 0);
  EXPECT_EQ(fake_.num_forbidden, 0);
  EXPECT_EQ(fake_.num_forces_while_off, 0);
}

TEST_F(ForceDimension, EveryRotationSurvivesAsAQuaternion) {
  for (const Vec3d& axis : {Vec3d{1, 0, 0}, Vec3d{0, 1, 0}, Vec3d{0, 0, 1}, Vec3d{1, 1, 1}}) {
    for (const double angle : {0.0, 1.0, 3.1, M_PI, 4.0}) {
      const Mat3d R = rotation_matrix(axis_angle(axis, angle));
      for (int i = 0; i < 9; ++i) fake_.rotation[i] = R.m[i / 3][i % 3];
      auto device = open();
      DeviceState seen;
      std::atomic<bool> has_seen = false;
      ASSERT_TRUE(device
                      ->start([&](const DeviceState& state) {
                        seen = state;
                        has_seen = true;
                        return Wrench{};
                      })
                      .has_value());
      ASSERT_TRUE(eventually([&] { return has_seen.load(); }));
      device->stop();
      // The same turn about the same axis of the room, whose x, y and z the SDK calls y, z and x.
      const Vec3d axis_B{axis.y, axis.z, axis.x};
      const Mat3d back = rotation_matrix(seen.X_BH.rotation),
                  expected = rotation_matrix(axis_angle(axis_B, angle));
      for (int i = 0; i < 9; ++i)
        EXPECT_NEAR(back.m[i / 3][i % 3], expected.m[i / 3][i % 3], 1e-12);
    }
  }
}

TEST_F(ForceDimension, WithoutAWristItIsStraightAndWithoutTorque) {
  fake_.has_wrist = fake_.has_active_wrist = false;
  fake_.rotation[0] = 17;
  auto device = open();
  DeviceState seen;
  std::atomic<int> num_ticks = 0;
  ASSERT_TRUE(device
                  ->start([&](const DeviceState& state) {
                    seen = state;
                    ++num_ticks;
                    return kPush;
                  })
                  .has_value());
  ASSERT_TRUE(eventually([&] { return fake_.wrench[0] != 0; }));
  for (int i = 3; i < 7; ++i) EXPECT_EQ(fake_.wrench[i], 0);
  device->stop();
  EXPECT_TRUE(seen.is_valid);
  EXPECT_EQ(seen.X_BH.rotation, Quaternion{});
}

TEST_F(ForceDimension, TooMuchIsShortenedAndNonsenseIsNoForce) {
  auto device = running({{30, 0, 40}, {}});
  EXPECT_NEAR(fake_.wrench[1], 12 * 0.6, 1e-12);
  EXPECT_NEAR(fake_.wrench[0], 12 * 0.8, 1e-12);
  device->stop();
  fake_.reset();
  const double nan = std::numeric_limits<double>::quiet_NaN();
  std::atomic<int> num_ticks = 0;
  ASSERT_TRUE(
      device->start([&](const DeviceState&) {
              return ++num_ticks, Wrench{{1, 2, 3}, {0, nan, 0}};
            })
          .has_value());
  EXPECT_TRUE(eventually([&] { return num_ticks > 50; }));
  EXPECT_EQ(fake_.largest_force, 0);
}

TEST_F(ForceDimension, ADeviceThatVanishesIsAnError) {
  auto device = running(kPush);
  fake_.read_result = -1;
  ASSERT_TRUE(eventually([&] { return !device->status(); }));
  EXPECT_EQ(device->status().error().code, Errc::io_failure);
  EXPECT_TRUE(contains(device->status().error().message, "communication error"))
      << device->status().error().message;
  ASSERT_TRUE(eventually([&] { return !fake_.is_force_enabled; }));
  expect_no_force();

  // Plugged in again.
  fake_.read_result = 0;
  ASSERT_TRUE(device->start([&](const DeviceState&) { return kPush; }).has_value());
  EXPECT_TRUE(eventually([&] { return fake_.wrench[0] != 0; }));
  EXPECT_TRUE(device->status().has_value());
  fake_.write_result = -1;
  EXPECT_TRUE(eventually([&] { return !device->status(); }));
}

TEST_F(ForceDimension, NoForceWhileTheDeviceSaysNothing) {
  fake_.position[1] = 0.5;
  auto device = open();
  std::atomic<int> num_invalid = 0, num_valid = 0;
  ASSERT_TRUE(device
                  ->start([&](const DeviceState& state) {
                    ++(state.is_valid ? num_valid : num_invalid);
                    if (!state.is_valid && num_invalid == 5) fake_.position[0] = 0;
                    EXPECT_EQ(state.X_BH.translation.x, 0.5);  // the old one when invalid
                    return kPush;
                  })
                  .has_value());
  ASSERT_TRUE(eventually([&] { return fake_.wrench[0] != 0; }));
  fake_.position[0] = std::numeric_limits<double>::quiet_NaN();
  EXPECT_TRUE(eventually([&] { return num_invalid == 5; }));
  const int num_valid_then = num_valid;
  EXPECT_TRUE(eventually([&] { return num_valid > num_valid_then + 10; }));
  EXPECT_TRUE(device->status().has_value());
}

TEST_F(ForceDimension, WhenTheDeviceShutsItsForceOffSoDoWe) {
  const struct {
    int cause;
    const char* words;
  } causes[] = {{1, "button"}, {2, "velocity limit"}, {3, "watchdog"},        {4, "program"},
                {5, "USB"},    {6, "dead-man"},       {0, "does not say why"}};
  for (const auto& [cause, words] : causes) {
    fake_.reset();
    auto device = running(kPush);
    fake_.force_off_cause = cause;
    fake_.takes_force = false;
    ASSERT_TRUE(eventually([&] { return !device->status(); }));
    EXPECT_TRUE(contains(device->status().error().message, words))
        << device->status().error().message;
    EXPECT_TRUE(eventually([&] { return !fake_.is_force_enabled; }));
    expect_no_force();
  }
}

TEST_F(ForceDimension, NothingIsSentBeforeTheDeviceSaysThatItsForceIsOn) {
  fake_.takes_force = false;
  auto device = open();
  std::atomic<int> num_ticks = 0;
  ASSERT_TRUE(device->start([&](const DeviceState&) { return ++num_ticks, kPush; }).has_value());
  ASSERT_TRUE(eventually([&] { return num_ticks > 30; }));
  EXPECT_EQ(fake_.largest_force, 0);
  fake_.takes_force = true;
  EXPECT_TRUE(eventually([&] { return fake_.largest_force > 0 || !device->status(); }));
}

TEST_F(ForceDimension, ADeviceThatTakesNoForceDoesNotStart) {
  fake_.enable_result = -1;
  auto device = open();
  const Status started = device->start([](const DeviceState&) { return Wrench{}; });
  ASSERT_FALSE(started.has_value());
  EXPECT_TRUE(contains(started.error().message, "does not take forces: communication error"))
      << started.error().message;
  expect_no_force();
}

TEST_F(ForceDimension, ACallThatNeverReturnsIsGivenUp) {
  for (const char* call : {"dhdGetPositionAndOrientationFrame", "dhdGetStatus",
                           "dhdSetForceAndTorqueAndGripperForce", "dhdGetButtonMask"}) {
    fake_.reset();
    const auto num_ticks = std::make_shared<std::atomic<int>>(0);
    auto device = open();
    ASSERT_TRUE(
        device->start([num_ticks, F = kPush](const DeviceState&) { return ++*num_ticks, F; }));
    EXPECT_TRUE(eventually([&] { return fake_.wrench[0] != 0; })) << call;
    fake_.hang.in = call;
    ASSERT_TRUE(eventually([&] { return fake_.hang.num_hanging > 0; })) << call;
    device->stop();
    const Status status = device->status();
    ASSERT_FALSE(status.has_value()) << call;
    EXPECT_TRUE(contains(status.error().message, "does not return from a call")) << call;
    EXPECT_FALSE(device->start([](const DeviceState&) { return Wrench{}; }).has_value());
    // Another thread switches it off.
    EXPECT_TRUE(eventually([&] { return !fake_.is_force_enabled; })) << call;
    device.reset();
    EXPECT_EQ(fake_.num_open, 1) << call;
    EXPECT_TRUE(is_any_call_hung());
    // It comes back when nobody waits any more: no tick, no force, and the device is closed.
    const int num_then = *num_ticks;
    fake_.hang.in = nullptr;
    EXPECT_TRUE(eventually([&] { return fake_.num_open == 0; })) << call;
    EXPECT_TRUE(eventually([] { return !is_any_call_hung(); }));
    EXPECT_EQ(*num_ticks, num_then) << call;
    expect_no_force();
  }
}

TEST_F(ForceDimension, ADriverThatDoesNotReturnFromOpeningOrLookingIsLeft) {
  fake_.hang.in = "drdOpenID";
  const auto device = open_device_within(0.1, "forcedimension");
  ASSERT_FALSE(device);
  EXPECT_TRUE(contains(device.error().message,
                       "the driver of forcedimension has not returned for 0.1 s while the device "
                       "was opened; switch"))
      << device.error().message;
  EXPECT_TRUE(is_any_call_hung());
  ASSERT_TRUE(eventually([&] { return fake_.hang.num_hanging > 0; }));
  fake_.hang.in = "dhdGetDeviceCount";  // the device that has been opened after all is closed
  EXPECT_TRUE(eventually([&] { return !is_any_call_hung() && fake_.num_open == 0; }));
  std::string what;
  for (const FoundDevice& found : find_devices_within(0.1))
    if (found.kind == "forcedimension") what = found.what;
  EXPECT_EQ(what, "its driver has not returned for 0.1 s");
  EXPECT_TRUE(is_any_call_hung());
  fake_.hang.in = nullptr;
  EXPECT_TRUE(eventually([] { return !is_any_call_hung(); }));
}

TEST_F(ForceDimension, ADeviceThatDoesNotCloseIsLeft) {
  auto device = running(kPush);
  fake_.hang.in = "drdClose";
  device.reset();
  expect_no_force();
  EXPECT_TRUE(is_any_call_hung());
  fake_.hang.in = nullptr;
  EXPECT_TRUE(eventually([] { return !is_any_call_hung(); }));
}

// Without a force for a moment, the hand has moved on: all of it at once would be a blow.
TEST_F(ForceDimension, TheForceComesBackSlowlyWhenTheDeviceHadNone) {
  auto device = open();
  std::atomic<bool> is_without = false;
  ASSERT_TRUE(device->start([&, F = kPush](const DeviceState&) {
    if (is_without && fake_.wrench[0] == 0) {  // before the device is given up
      fake_.largest_step = 0;
      fake_.read_result = 0;
      fake_.takes_force = true;
      is_without = false;
    }
    return F;
  }));
  ASSERT_TRUE(eventually([&] { return fake_.wrench[0] == 3; }));
  for (const bool is_silent : {false, true}) {
    (is_silent ? fake_.read_result : fake_.status_result) = is_silent ? -1 : 0;
    fake_.takes_force = is_silent;
    is_without = true;
    ASSERT_TRUE(eventually([&] { return !is_without; }));
    ASSERT_TRUE(eventually([&] { return fake_.wrench[0] == 3; })) << fake_.wrench[0].load();
    EXPECT_GT(fake_.largest_step, 0);
    EXPECT_LT(fake_.largest_step, 0.03);  // 3 N in 200 ticks: 0.015 N at each
    EXPECT_TRUE(device->status().has_value());
  }
}

// A call that fails once is no device without a force: that would be a fault, and four of them in a
// minute an end.
TEST_F(ForceDimension, ACallThatFailsNowAndThenLeavesTheForce) {
  auto device = open();
  std::atomic<int> num_failed = 0, num_without = 0;
  std::atomic<bool> has_begun = false;
  int num_ticks = 0;
  ASSERT_TRUE(device->start([&](const DeviceState& state) {
    if (!has_begun) return kPush;
    num_without += state.has_force ? 0 : 1;
    num_failed += state.is_valid ? 0 : 1;
    fake_.read_result = ++num_ticks % 20 < 3 ? -1 : 0;
    // Looked at once in ten ticks: every other look fails.
    fake_.status_result = num_ticks % 20 < 10 ? -1 : 0;
    return kPush;
  }));
  ASSERT_TRUE(eventually([&] { return fake_.wrench[0] == 3; }));
  fake_.largest_step = 0;
  has_begun = true;
  EXPECT_TRUE(eventually([&] { return num_failed >= 30; }));
  EXPECT_EQ(num_without, 0);
  EXPECT_EQ(fake_.largest_step, 0);
  EXPECT_TRUE(device->status().has_value());
}

// And the safety filter knows of it.
TEST_F(ForceDimension, AForceThatTheDeviceShutsOffIsAFaultThatPasses) {
  const auto device = open();
  test::expect_to_fade_and_return(*device, [&](bool is_off) { fake_.takes_force = !is_off; });
}

TEST_F(ForceDimension, ATransformThatIsNoRotationIsNoPose) {
  const double all[][9] = {{0, 0, 0, 0, 0, 0, 0, 0, 0},
                           {2, 0, 0, 0, 2, 0, 0, 0, 2},
                           {1, 0, 0, 0, 1, 0, 0, 0, -1},
                           {1, 0.5, 0, 0, 1, 0, 0, 0, 1}};
  for (const auto& matrix : all) {
    fake_.reset();
    auto device = open();
    for (int i = 0; i < 9; ++i) fake_.rotation[i] = matrix[i];
    std::atomic<bool> has_valid = false;
    ASSERT_TRUE(device->start([&](const DeviceState& state) {
      has_valid = has_valid || state.is_valid;
      return Wrench{};
    }));
    EXPECT_TRUE(eventually([&] { return !device->status(); }));  // so many in a row
    EXPECT_FALSE(has_valid);
  }
}

TEST_F(ForceDimension, APositionThatNoDeviceReachesIsNoPose) {
  fake_.position[1] = 0.05;
  auto device = running(kPush);
  std::atomic<bool> is_far = false;
  device->stop();
  ASSERT_TRUE(device->start([&](const DeviceState& state) {
    is_far = is_far || norm(state.X_BH.translation) > 1;
    return kPush;
  }));
  fake_.position[2] = 1e308;
  EXPECT_TRUE(eventually([&] { return !device->status(); }));
  EXPECT_FALSE(is_far);
}

TEST_F(ForceDimension, ALostStatusIsALostDevice) {
  auto device = running(kPush);
  fake_.status_result = -1;
  EXPECT_TRUE(eventually([&] { return !device->status(); }));
}

}  // namespace
}  // namespace palpate
