// Against a fake OpenHaptics: a shared library with the functions of the real one and a scheduler
// thread of its own.
#include <gtest/gtest.h>

#include <atomic>
#include <chrono>
#include <cmath>
#include <cstdlib>
#include <limits>
#include <memory>
#include <string_view>
#include <thread>

#include "src/core/internal/bounded_call.h"
#include "src/devices/device_kinds.h"
#include "tests/devices/fake_hd.h"
#include "tests/devices/fake_sdk.h"
#include "tests/devices/filtered_hand.h"
#include "tests/test_util/allocation_counter.h"

namespace palpate {
namespace {

using test::contains;
using test::eventually;

constexpr unsigned kWarmMotors = 0x200, kExceededMaxVelocity = 0x203, kCommError = 0x302;

class OpenHaptics : public testing::Test {
 protected:
  void SetUp() override {
    setenv("OH_SDK_BASE", FAKE_SDK_FOLDER "/whole", 1);
    fake_.reset();
  }
  void TearDown() override {
    EXPECT_EQ(fake_.num_outside, 0);
    EXPECT_EQ(fake_.num_illegal, 0);
    fake_.is_hanging = false;
  }

  static std::unique_ptr<HapticDevice> open(std::string_view address = "") {
    auto device = open_open_haptics_device(address);
    EXPECT_TRUE(device.has_value()) << (device ? "" : device.error().message);
    return device ? std::move(*device) : nullptr;
  }
  static Error open_error(std::string_view address = "") {
    const auto device = open_open_haptics_device(address);
    EXPECT_FALSE(device.has_value());
    return device ? Error{} : device.error();
  }
  std::unique_ptr<HapticDevice> running(const Wrench& F) {
    auto device = open();
    EXPECT_TRUE(device->start([F](const DeviceState&) { return F; }).has_value());
    EXPECT_TRUE(eventually([&] { return fake_.force[0] != 0; }));
    return device;
  }
  void expect_no_force() {
    for (const auto& part : fake_.force) EXPECT_EQ(part, 0);
    for (const auto& part : fake_.torque) EXPECT_EQ(part, 0);
  }
  void expect_stopped() {
    expect_no_force();
    EXPECT_FALSE(fake_.is_scheduler_on);
    EXPECT_EQ(fake_.num_scheduled, 0);
    EXPECT_FALSE(fake_.capabilities[0]);  // HD_FORCE_OUTPUT
  }

  test::FakeHd& fake_ =
      test::fake_control<test::FakeHd>(FAKE_SDK_FOLDER "/whole/lib/libHD.so", "fake_hd");
  const Wrench kPush{{1, 2, 3}, {0.01, 0.02, 0.03}};
};

TEST_F(OpenHaptics, WithoutTheLibraryEveryPathIsNamed) {
  setenv("OH_SDK_BASE", "/nonexistent/sdk", 1);
  const auto device = open_open_haptics_device("");
  if (device.has_value()) GTEST_SKIP() << "SKIPPED: there is OpenHaptics on this machine";
  EXPECT_EQ(device.error().code, Errc::not_found);
  for (const char* part : {"/nonexistent/sdk/lib/libHD.so", "/usr/lib/libHD.so", "OH_SDK_BASE"})
    EXPECT_TRUE(contains(device.error().message, part)) << device.error().message;
  const FoundDevice found = find_open_haptics_device();
  EXPECT_FALSE(found.is_usable);
  EXPECT_TRUE(contains(found.what, "/usr/lib/libHD.so")) << found.what;
  EXPECT_TRUE(contains(found.hint, "install")) << found.hint;
}

TEST_F(OpenHaptics, MissingFunctionsAreNamed) {
  setenv("OH_SDK_BASE", FAKE_SDK_FOLDER "/incomplete", 1);
  const Error error = open_error();
  EXPECT_EQ(error.code, Errc::unavailable);
  EXPECT_TRUE(contains(error.message, "lacks hdUnschedule:")) << error.message;
}

TEST_F(OpenHaptics, FindingClaimsNothing) {
  const FoundDevice found = find_open_haptics_device();
  EXPECT_TRUE(found.is_usable);
  EXPECT_EQ(found.uri, "openhaptics");
  EXPECT_TRUE(contains(found.what, "/whole/lib/libHD.so")) << found.what;
  EXPECT_EQ(fake_.opened_name, "");
}

TEST_F(OpenHaptics, DevicesHaveNames) {
  open();
  EXPECT_EQ(fake_.opened_name, "(default)");
  EXPECT_FALSE(fake_.is_enabled);
  const auto device = open("Left Device");
  EXPECT_EQ(fake_.opened_name, "Left Device");
  EXPECT_EQ(device->info().name, "PHANTOM Premium 012345, 'Left Device'");
  EXPECT_TRUE(fake_.is_enabled);
}

TEST_F(OpenHaptics, NoDeviceAndOneThatIsInUse) {
  fake_.init_error = 0x300;
  Error error = open_error("Left Device");
  EXPECT_EQ(error.code, Errc::not_found);
  EXPECT_TRUE(contains(error.message, "'Left Device': HD_ERROR (0x0300, internal 11)"))
      << error.message;
  fake_.init_error = 0x301;
  error = open_error();
  EXPECT_EQ(error.code, Errc::io_failure);
  EXPECT_TRUE(contains(error.message, "in use already")) << error.message;
}

TEST_F(OpenHaptics, Calibration) {
  fake_.calibration = 0x5001;
  open();
  EXPECT_EQ(fake_.updated_style, 4u);
  fake_.calibration = 0x5002;
  Error error = open_error();
  EXPECT_EQ(error.code, Errc::unavailable);
  EXPECT_TRUE(contains(error.message, "inkwell")) << error.message;
  EXPECT_FALSE(fake_.is_enabled);
  // Encoders that must be set to zero by hand are not calibrated behind the user's back.
  fake_.calibration = 0x5001;
  fake_.calibration_style = 1;
  fake_.updated_style = 0;
  error = open_error();
  EXPECT_TRUE(contains(error.message, "Touch_Setup")) << error.message;
  EXPECT_EQ(fake_.updated_style, 0u);
}

TEST_F(OpenHaptics, LimitsAreAskedFor) {
  DeviceLimits limits = open()->info().limits;
  EXPECT_EQ(limits.max_force, 8.5);
  EXPECT_DOUBLE_EQ(limits.max_torque, 0.188);
  EXPECT_DOUBLE_EQ(limits.max_stiffness, 800);
  EXPECT_DOUBLE_EQ(limits.max_damping, 5);
  EXPECT_DOUBLE_EQ(limits.max_angular_stiffness, 0.3);
  // Damping that is passive at 1 kHz with these stiffnesses, as of the models: K = 2 b / T.
  EXPECT_DOUBLE_EQ(limits.damping, 0.4);
  EXPECT_DOUBLE_EQ(limits.angular_damping, 0.15e-3);
  EXPECT_DOUBLE_EQ(limits.workspace_radius, 0.07);
  fake_.output_dof = 3;
  limits = open()->info().limits;
  EXPECT_EQ(limits.max_torque, 0);
  EXPECT_EQ(limits.max_angular_stiffness, 0);
  fake_.knows_limits = false;
  limits = open()->info().limits;
  EXPECT_EQ(limits.max_force, 3.3);
  EXPECT_GT(limits.workspace_radius, 0);
}

// Limits that the driver reports are checked: they are the last guard of the hand.
TEST_F(OpenHaptics, LimitsThatCannotBeAreThoseOfTheWeakestDevice) {
  for (const double factor : {0.0, -1.0, 1e6, 1e300, std::numeric_limits<double>::infinity(),
                              std::numeric_limits<double>::quiet_NaN()}) {
    fake_.limit_factor = factor;
    const DeviceLimits limits = open()->info().limits;
    EXPECT_EQ(limits.max_force, 3.3) << factor;
    EXPECT_EQ(limits.max_torque, 0) << factor;
    EXPECT_LT(limits.max_stiffness, 1e5) << factor;
    EXPECT_GT(limits.max_stiffness, 0) << factor;
    EXPECT_LT(limits.workspace_radius, 1) << factor;
    EXPECT_GT(limits.workspace_radius, 0) << factor;
  }
}

TEST_F(OpenHaptics, StateAndWrench) {
  const Quaternion turn = axis_angle({1, -2, 0.5}, 2.5);
  const Mat3d R = rotation_matrix(turn);
  for (int i = 0; i < 3; ++i) {
    for (int j = 0; j < 3; ++j) fake_.transform[4 * j + i] = R.m[i][j];
    fake_.transform[12 + i] = 10 * (i + 1);
    fake_.velocity[i] = 100 * (i + 1);
    fake_.angular_velocity[i] = i + 1;
  }
  fake_.buttons = 3;
  auto device = open();
  EXPECT_EQ(fake_.num_scheduled, 0);
  EXPECT_EQ(fake_.num_frames, 0);
  DeviceState seen;
  std::atomic<int> num_ticks = 0;
  std::atomic<std::size_t> allocations_before = 0, allocations_after = 0;
  ASSERT_TRUE(device
                  ->start([&](const DeviceState& state) {
                    if (num_ticks == 5) allocations_before = test::num_allocations();
                    if (num_ticks == 150) allocations_after = test::num_allocations();
                    seen = state;
                    ++num_ticks;
                    return kPush;
                  })
                  .has_value());
  ASSERT_TRUE(eventually([&] { return num_ticks > 200; }));
  EXPECT_EQ(allocations_before, allocations_after);
  EXPECT_TRUE(device->status().has_value());
  for (const auto& capability : fake_.capabilities) EXPECT_TRUE(capability);
  for (int i = 0; i < 3; ++i) {
    EXPECT_EQ(fake_.force[i], i + 1);
    EXPECT_DOUBLE_EQ(fake_.torque[i], 10 * (i + 1));  // mN m
  }
  device->stop();
  expect_stopped();
  const int num_calls = fake_.num_calls;
  EXPECT_TRUE(seen.is_valid);
  for (int i = 0; i < 3; ++i) {
    EXPECT_DOUBLE_EQ(seen.X_BH.translation[i], 0.01 * (i + 1));
    EXPECT_DOUBLE_EQ(seen.V_BH.linear[i], 0.1 * (i + 1));
    EXPECT_EQ(seen.V_BH.angular[i], i + 1);
  }
  const Mat3d back = rotation_matrix(seen.X_BH.rotation);
  for (int i = 0; i < 9; ++i) EXPECT_NEAR(back.m[i / 3][i % 3], R.m[i / 3][i % 3], 1e-12);
  EXPECT_EQ(seen.buttons, 3u);

  // Once more, and gone with the device.
  num_ticks = 1000;
  ASSERT_TRUE(device->start([&](const DeviceState&) { return ++num_ticks, kPush; }).has_value());
  EXPECT_TRUE(eventually([&] { return num_ticks > 1050; }));
  device.reset();
  expect_stopped();
  EXPECT_GT(fake_.num_calls, num_calls);
  EXPECT_FALSE(fake_.is_enabled);
}

TEST_F(OpenHaptics, WithoutAGimbalItIsStraightAndWithoutTorque) {
  fake_.input_dof = fake_.output_dof = 3;
  fake_.transform[0] = 17;
  auto device = open();
  EXPECT_FALSE(device->info().senses_orientation);
  DeviceState seen;
  std::atomic<int> num_ticks = 0;
  ASSERT_TRUE(device
                  ->start([&](const DeviceState& state) {
                    seen = state;
                    ++num_ticks;
                    return kPush;
                  })
                  .has_value());
  ASSERT_TRUE(eventually([&] { return num_ticks > 20; }));
  EXPECT_EQ(fake_.torque[0], 0);
  device->stop();
  EXPECT_TRUE(seen.is_valid);
  EXPECT_EQ(seen.X_BH.rotation, Quaternion{});
}

TEST_F(OpenHaptics, TooMuchIsShortenedAndNonsenseIsNoForce) {
  auto device = running({{30, 0, 40}, {}});
  EXPECT_NEAR(fake_.force[0], 8.5 * 0.6, 1e-12);
  EXPECT_NEAR(fake_.force[2], 8.5 * 0.8, 1e-12);
  device->stop();
  fake_.reset();
  const double nan = std::numeric_limits<double>::quiet_NaN();
  std::atomic<int> num_ticks = 0;
  ASSERT_TRUE(device->start([&](const DeviceState&) {
                      return ++num_ticks, Wrench{{1, 2, nan}, {}};
                    })
                  .has_value());
  EXPECT_TRUE(eventually([&] { return num_ticks > 50; }));
  EXPECT_EQ(fake_.largest_force, 0);
}

TEST_F(OpenHaptics, ForceErrorsAreARestWithoutForce) {
  auto device = running(kPush);
  fake_.frame_error = kExceededMaxVelocity;
  EXPECT_TRUE(eventually([&] { return fake_.force[0] == 0; }));
  EXPECT_TRUE(device->status().has_value());
  const int num_frames = fake_.num_frames;
  EXPECT_TRUE(eventually([&] { return fake_.num_frames > num_frames + 10; }));
  expect_no_force();
  fake_.largest_step = 0;
  fake_.frame_error = 0;
  // Slowly, as the hand has moved on meanwhile.
  EXPECT_TRUE(eventually([&] { return fake_.force[0] == 1; }));
  EXPECT_GT(fake_.largest_step, 0);
  EXPECT_LT(fake_.largest_step, 0.01);  // 1 N in 200 frames: 0.005 N at each
  EXPECT_GT(fake_.num_frames, num_frames + 100);
  EXPECT_TRUE(device->status().has_value());
}

// The safety filter knows of a force that the driver withholds: it comes back by the filter's
// ramp.
TEST_F(OpenHaptics, AForceErrorIsAFaultThatPasses) {
  const auto device = open();
  test::expect_to_fade_and_return(
      *device, [&](bool is_tired) { fake_.frame_error = is_tired ? kExceededMaxVelocity : 0; });
}

TEST_F(OpenHaptics, MotorsThatStayWarmAreTheEnd) {
  auto device = running(kPush);
  fake_.period_microseconds = 10;
  fake_.frame_error = kWarmMotors;
  ASSERT_TRUE(eventually([&] { return !device->status(); }));
  EXPECT_TRUE(contains(device->status().error().message, "HD_WARM_MOTORS"));
  EXPECT_TRUE(contains(device->status().error().message, "cool down"));
  EXPECT_TRUE(eventually([&] { return fake_.num_scheduled == 0; }));
  expect_no_force();
}

TEST_F(OpenHaptics, ADeviceThatVanishesIsAnError) {
  for (const bool while_reading : {false, true}) {
    fake_.reset();
    auto device = running(kPush);
    (while_reading ? fake_.read_error : fake_.frame_error) = kCommError;
    ASSERT_TRUE(eventually([&] { return !device->status(); }));
    EXPECT_EQ(device->status().error().code, Errc::io_failure);
    EXPECT_TRUE(contains(device->status().error().message, "HD_COMM_ERROR (0x0302"))
        << device->status().error().message;
    EXPECT_TRUE(eventually([&] { return fake_.num_scheduled == 0; }));
    expect_no_force();
    device->stop();
    expect_stopped();
    EXPECT_FALSE(device->status().has_value());

    // Plugged in again.
    fake_.reset();
    ASSERT_TRUE(device->start([&](const DeviceState&) { return kPush; }).has_value());
    EXPECT_TRUE(device->status().has_value());
    EXPECT_TRUE(eventually([&] { return fake_.force[0] != 0; }));
  }
}

TEST_F(OpenHaptics, NoForceForAPoseThatIsNoNumber) {
  fake_.transform[13] = 20;
  auto device = running(kPush);
  fake_.transform[12] = std::numeric_limits<double>::quiet_NaN();
  EXPECT_TRUE(eventually([&] { return fake_.force[0] == 0; }));
  fake_.transform[12] = 0;
  EXPECT_TRUE(eventually([&] { return fake_.force[0] != 0; }));
  EXPECT_TRUE(device->status().has_value());
}

TEST_F(OpenHaptics, OnePoseThatIsNoNumberLeavesTheForce) {
  auto device = open();
  std::atomic<int> num_unusable = 0, num_without = 0;
  int num_ticks = 0;
  ASSERT_TRUE(device->start([&](const DeviceState& state) {
    num_without += state.has_force ? 0 : 1;
    num_unusable += state.is_valid ? 0 : 1;
    fake_.transform[12] = ++num_ticks % 20 < 3 ? std::numeric_limits<double>::quiet_NaN() : 0;
    return kPush;
  }));
  EXPECT_TRUE(eventually([&] { return num_unusable >= 30; }));
  EXPECT_EQ(num_without, 0);
  EXPECT_TRUE(device->status().has_value());
}

TEST_F(OpenHaptics, ASchedulerThatDoesNotStart) {
  fake_.start_error = 0x304;
  auto device = open();
  const Status started = device->start([](const DeviceState&) { return Wrench{}; });
  ASSERT_FALSE(started.has_value());
  EXPECT_TRUE(contains(started.error().message, "does not start: HD_ERROR (0x0304"))
      << started.error().message;
  expect_stopped();
  fake_.start_error = 0;
  EXPECT_TRUE(device->start([](const DeviceState&) { return Wrench{}; }).has_value());
}

TEST_F(OpenHaptics, ACallThatNeverReturnsIsGivenUp) {
  for (const char* call : {"hdStopScheduler", "hdBeginFrame", "hdEndFrame", "hdSetDoublev"}) {
    fake_.reset();
    const auto num_ticks = std::make_shared<std::atomic<int>>(0);
    auto device = open();
    ASSERT_TRUE(
        device->start([num_ticks, F = kPush](const DeviceState&) { return ++*num_ticks, F; }));
    EXPECT_TRUE(eventually([&] { return fake_.force[0] != 0; })) << call;
    fake_.hang.in = call;
    if (std::string_view(call) != "hdStopScheduler") {
      ASSERT_TRUE(eventually([&] { return fake_.hang.num_hanging > 0; })) << call;
    }
    device->stop();
    ASSERT_FALSE(device->status().has_value()) << call;
    EXPECT_TRUE(contains(device->status().error().message, "does not call back")) << call;
    EXPECT_TRUE(eventually([&] { return !fake_.capabilities[0]; })) << call;  // HD_FORCE_OUTPUT
    EXPECT_FALSE(device->start([](const DeviceState&) { return Wrench{}; }).has_value());
    device.reset();
    EXPECT_TRUE(is_any_call_hung()) << call;  // so the program does not wait for it at its end
    const int num_then = *num_ticks;
    fake_.hang.in = nullptr;
    EXPECT_TRUE(eventually([&] { return fake_.num_scheduled == 0; })) << call;
    EXPECT_TRUE(eventually([] { return !is_any_call_hung(); })) << call;
    EXPECT_LE(*num_ticks, num_then) << call;
  }
}

// A loop asks for the status of a device while it starts.
TEST_F(OpenHaptics, IsNotStuckBeforeItsFirstCall) {
  const auto device = open();
  fake_.is_hanging = true;
  std::atomic<bool> has_started = false;
  std::thread asks([&] {
    for (int i = 0; i < 10; ++i, std::this_thread::sleep_for(std::chrono::milliseconds(2)))
      EXPECT_TRUE(device->status().has_value());
    fake_.is_hanging = false;
    while (!has_started) EXPECT_TRUE(device->status().has_value());
  });
  EXPECT_TRUE(device->start([](const DeviceState&) { return Wrench{}; }).has_value());
  has_started = true;
  asks.join();
  for (int i = 0; i < 3; ++i) {
    device->stop();
    EXPECT_TRUE(device->start([](const DeviceState&) { return Wrench{}; }).has_value());
    EXPECT_TRUE(device->status().has_value());
  }
}

TEST_F(OpenHaptics, AStartThatWasGivenUpIsUndoneWhenItComesBack) {
  const auto device = open();
  fake_.hang.in = "hdEnable";
  std::atomic<int> num_ticks = 0;
  EXPECT_FALSE(device->start([&](const DeviceState&) {
    return ++num_ticks, Wrench{{1, 0, 0}, {}};
  }));
  EXPECT_TRUE(is_any_call_hung());
  fake_.hang.in = nullptr;
  EXPECT_TRUE(eventually([] { return !is_any_call_hung(); }));
  expect_stopped();
  EXPECT_EQ(num_ticks, 0);
}

TEST_F(OpenHaptics, ADeviceThatDoesNotCloseIsLeft) {
  auto device = running(kPush);
  fake_.hang.in = "hdDisableDevice";
  device.reset();
  expect_stopped();
  EXPECT_TRUE(is_any_call_hung());
  fake_.hang.in = nullptr;
  EXPECT_TRUE(eventually([] { return !is_any_call_hung(); }));
}

TEST_F(OpenHaptics, ATransformThatIsNoRotationIsNoPose) {
  auto device = running(kPush);
  fake_.transform[0] = 0;
  EXPECT_TRUE(eventually([&] { return fake_.force[0] == 0; }));
  fake_.transform[0] = 1;
  EXPECT_TRUE(eventually([&] { return fake_.force[0] == 1; }));
}

TEST_F(OpenHaptics, APositionThatNoDeviceReachesIsNoPose) {
  auto device = running(kPush);
  fake_.transform[13] = 1e6;  // mm
  EXPECT_TRUE(eventually([&] { return fake_.force[0] == 0; }));
  fake_.transform[13] = 1;
  EXPECT_TRUE(eventually([&] { return fake_.force[0] == 1; }));
}

TEST_F(OpenHaptics, ADriverThatHangs) {
  auto device = running(kPush);
  fake_.is_hanging = true;
  const int num_idle = fake_.num_idle;
  ASSERT_TRUE(eventually([&] { return fake_.num_idle > num_idle; }));  // the call that ran is over
  device->stop();
  ASSERT_FALSE(device->status());
  EXPECT_TRUE(contains(device->status().error().message, "does not call back"));
  device.reset();
  EXPECT_TRUE(eventually([&] { return !fake_.capabilities[0]; }));  // HD_FORCE_OUTPUT
  // It wakes up when the device is gone: one last call, without force.
  fake_.is_hanging = false;
  EXPECT_TRUE(eventually([&] { return fake_.num_scheduled == 0; }));
  expect_no_force();
}

}  // namespace
}  // namespace palpate
