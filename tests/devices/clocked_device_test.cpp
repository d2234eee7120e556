#include "src/devices/internal/polling_device.h"

#include <gtest/gtest.h>

#include <atomic>
#include <chrono>
#include <functional>
#include <thread>
#include <vector>

#include "src/core/internal/monotonic_clock.h"
#include "tests/test_util/allocation_counter.h"
#include "tests/test_util/wait_for.h"

namespace palpate {
namespace {

using test::wait_for;

constexpr double kStep = 1.0 / 1024;  // m at each tick

/// Script and log of a driver: the calls that it gets, and when it gives up.
struct Diary {
  bool begins = true;
  std::function<void()> while_beginning;
  int lost_at_read = -1, lost_at_write = -1;
  std::atomic<bool> is_wild = false;
  std::atomic<int> num_begun = 0, num_ended = 0, num_read = 0, num_written = 0;
  bool was_motor_on_in_read = true;
  double written = 0;
};

class ScriptedDevice final : public PolledDevice {
 public:
  explicit ScriptedDevice(Diary& diary) : diary_(diary) { info_.rate = 2000; }

  Status begin() override {
    if (diary_.while_beginning) diary_.while_beginning();
    if (!diary_.begins) return Error{Errc::unavailable, "unplugged"};
    ++diary_.num_begun;
    return Done{};
  }
  bool read(DeviceState& state) noexcept override {
    diary_.was_motor_on_in_read &= diary_.num_begun == diary_.num_ended + 1;
    state.X_BH.translation.x = diary_.is_wild ? 1e308 : state.X_BH.translation.x + kStep;
    state.is_valid = true;
    return ++diary_.num_read != diary_.lost_at_read;
  }
  bool write(const Wrench& F_H_B) noexcept override {
    diary_.written = F_H_B.force.x;
    return ++diary_.num_written != diary_.lost_at_write;
  }
  void end() noexcept override { ++diary_.num_ended; }
  Error trouble() const override { return {Errc::io_failure, "cable"}; }

 private:
  Diary& diary_;
};

TEST(PollingDevice, ReadsTicksAndWritesInTurnWithoutAllocating) {
  Diary diary;
  PollingDevice device(std::make_unique<ScriptedDevice>(diary));
  std::atomic<int> num_ticks = 0;
  std::size_t first_allocations = 0, allocations = 0;
  double last_time = 0;
  bool is_in_order = true;
  ASSERT_TRUE(device.start([&](const DeviceState& state) {
    if (num_ticks == 0) first_allocations = test::num_allocations();
    allocations = test::num_allocations();
    ++num_ticks;
    is_in_order = is_in_order && state.time > last_time &&
                  state.X_BH.translation.x == kStep * num_ticks && diary.num_read == num_ticks &&
                  diary.num_written == num_ticks - 1;
    last_time = state.time;
    return Wrench{{static_cast<double>(num_ticks), 0, 0}, {}};
  }));
  EXPECT_TRUE(wait_for([&] { return num_ticks > 100; }));
  device.stop();
  EXPECT_TRUE(is_in_order);
  EXPECT_EQ(allocations, first_allocations);
  EXPECT_TRUE(diary.was_motor_on_in_read);
  EXPECT_EQ(diary.num_ended, 1);
  EXPECT_EQ(diary.written, num_ticks);
  EXPECT_NEAR(last_time, monotonic_now(), 60);
  EXPECT_TRUE(device.status().has_value());
  device.stop();  // once more does nothing
  EXPECT_EQ(diary.num_ended, 1);
}

TEST(PollingDevice, DoesNotStartWhatDoesNotAnswer) {
  Diary diary;
  diary.begins = false;
  PollingDevice device(std::make_unique<ScriptedDevice>(diary));
  const Status started = device.start([](const DeviceState&) { return Wrench{}; });
  ASSERT_FALSE(started.has_value());
  EXPECT_EQ(started.error().message, "unplugged");
  EXPECT_EQ(diary.num_read, 0);
  EXPECT_EQ(diary.num_ended, 0);
}

TEST(PollingDevice, ALostDeviceTurnsItsMotorsOffAndSaysWhy) {
  for (const bool at_read : {true, false}) {
    Diary diary;
    (at_read ? diary.lost_at_read : diary.lost_at_write) = 10;
    PollingDevice device(std::make_unique<ScriptedDevice>(diary));
    ASSERT_TRUE(device.start([](const DeviceState&) { return Wrench{}; }));
    EXPECT_TRUE(wait_for([&] { return diary.num_ended == 1; }));
    ASSERT_FALSE(device.status().has_value());
    EXPECT_EQ(device.status().error().message, "cable");
    EXPECT_EQ(diary.num_read, 10);
    EXPECT_EQ(diary.num_written, at_read ? 9 : 10);
    // It can be started again, and the error is gone by then.
    diary.while_beginning = [&] { EXPECT_TRUE(device.status().has_value()); };
    ASSERT_TRUE(device.start([](const DeviceState&) { return Wrench{}; }));
    EXPECT_TRUE(device.status().has_value());
    EXPECT_TRUE(wait_for([&] { return diary.num_read > 15; }));
    device.stop();
    EXPECT_EQ(diary.num_ended, 2);
  }
}

// After impossible poses of a driver the last possible one stays, and the hand goes on from there.
TEST(PollingDevice, APositionThatNoDeviceReachesIsNoState) {
  Diary diary;
  PollingDevice device(std::make_unique<ScriptedDevice>(diary));
  std::atomic<int> num_valid = 0, num_invalid = 0;
  std::atomic<bool> is_steady = true;
  ASSERT_TRUE(device.start([&](const DeviceState& state) {
    ++(state.is_valid ? num_valid : num_invalid);
    if (state.X_BH.translation.x != kStep * num_valid) is_steady = false;
    return Wrench{};
  }));
  EXPECT_TRUE(wait_for([&] { return num_valid > 5; }));
  diary.is_wild = true;
  EXPECT_TRUE(wait_for([&] { return num_invalid > 5; }));
  diary.is_wild = false;
  const int num_then = num_valid;
  EXPECT_TRUE(wait_for([&] { return num_valid > num_then + 5; }));
  device.stop();
  EXPECT_TRUE(is_steady);
}

TEST(PollingDevice, CanBeStoppedFromATick) {
  Diary diary;
  PollingDevice device(std::make_unique<ScriptedDevice>(diary));
  ASSERT_TRUE(device.start([&](const DeviceState&) {
    device.stop();
    return Wrench{};
  }));
  EXPECT_TRUE(wait_for([&] { return diary.num_ended == 1; }));
  EXPECT_EQ(diary.num_read, 1);
}

TEST(PeriodicThread, LeavesOversleptBeatsOutAndCountsThem) {
  PeriodicThread thread;
  std::vector<int> all_periods;
  all_periods.reserve(100);
  std::atomic<bool> is_over = false;
  double last_time = 0;
  const double begin = monotonic_now();
  ASSERT_TRUE(thread.start(
      1000,
      [&](double time, int periods) {
        last_time = time;
        all_periods.push_back(periods);
        if (all_periods.size() == 10) std::this_thread::sleep_for(std::chrono::milliseconds(30));
        return all_periods.size() < 20;
      },
      [&] { is_over = true; }));
  EXPECT_TRUE(wait_for([&] { return is_over.load(); }));
  thread.stop();
  ASSERT_EQ(all_periods.size(), 20u);
  EXPECT_EQ(all_periods[0], 1);
  EXPECT_GE(all_periods[10], 30);
  int sum = 0;
  for (const int periods : all_periods) {
    EXPECT_GE(periods, 1);
    sum += periods;
  }
  // Rounds are never ahead of their beats.
  EXPECT_GE(last_time - begin, 1e-3 * (sum - 1) - 1e-3);
}

TEST(PeriodicThread, RunsOneThingAtATime) {
  PeriodicThread thread;
  const auto round = [](double, int) { return true; };
  ASSERT_TRUE(thread.start(1000, round, [] {}));
  EXPECT_FALSE(thread.start(1000, round, [] {}));
  thread.stop();
  EXPECT_TRUE(thread.start(1000, round, [] {}));
}

}  // namespace
}  // namespace palpate
