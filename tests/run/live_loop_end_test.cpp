// Start and end of the live loop, by itself or due to its camera, its device or memory.
#include <gtest/gtest.h>

#include <algorithm>
#include <atomic>
#include <chrono>
#include <cmath>
#include <functional>
#include <mutex>
#include <new>
#include <span>
#include <stdexcept>
#include <string>
#include <vector>

#include "palpate/run/run_loop.h"
#include "tests/run/live_loop_fixtures.h"
#include "tests/test_util/allocation_counter.h"

namespace palpate {
namespace {

using test::box_tool;
using test::patient_settings;
using test::pressing_hand;
using test::ScriptedDevice;
using test::wait_for;
using test::WallSource;

TEST(LiveLoop, ASourceThatNeverReturnsHoldsUpNobody) {
  test::SilentSource source;
  ScriptedDevice device({});
  auto loop = RunLoop::create(box_tool(), source, device, patient_settings()).value();
  ASSERT_TRUE(loop->start());
  ASSERT_TRUE(wait_for([&] { return source.is_waiting(); }));
  loop->stop();
  EXPECT_FALSE(loop->is_running());
}

/// Runs until it has ended by itself; says how.
Status ending_of(RunLoop& loop) {
  if (const Status started = loop.start(); !started) return started;
  EXPECT_TRUE(wait_for([&] { return !loop.is_running(); }));
  loop.stop();
  return loop.status();
}

/// A wall whose thread has all the memory that it wants. When frames begin to have flow, which the
/// stream has not told, the thread that makes surfaces needs room to keep it.
class SparedWall final : public DepthSource {
 public:
  std::atomic<bool> has_flow = false;

  const DepthStreamInfo& info() const override { return wall_.info(); }
  Result<bool> next(DepthFrame& frame) override {
    test::RefusedAllocations::spare_this_thread();
    const auto got = wall_.next(frame);
    frame.flow.assign(has_flow ? 2 * frame.pixels.size() : 0, {});
    return got;
  }

 private:
  WallSource wall_{{}};
};

// Frames are handed on and not copied: larger ones cost the thread of surfaces no memory.
TEST(LiveLoop, AThreadOfSurfacesNeedsNoMemoryForLargerFrames) {
  SparedWall source;
  ScriptedDevice device({.hand = pressing_hand});
  std::atomic<int> num_with_flow = 0;
  RunObserver observer;
  observer.on_frame = [&](const FrameRecord&, const DepthFrame& frame) {
    num_with_flow += !frame.flow.empty();
  };
  auto loop =
      RunLoop::create(box_tool(), source, device, patient_settings(), std::move(observer)).value();
  test::RefusedAllocations::spare_this_thread();
  ASSERT_TRUE(loop->start());
  ASSERT_TRUE(wait_for([&] { return device.last_force() > 0; }));
  {
    const test::RefusedAllocations refused;
    source.has_flow = true;
    EXPECT_TRUE(wait_for([&] { return num_with_flow > 5; }));
  }
  EXPECT_TRUE(loop->is_running());
  EXPECT_GT(device.last_force(), 0);
  loop->stop();
  EXPECT_TRUE(loop->status());
}

TEST(LiveLoop, WhatACameraThrowsEndsTheRunWell) {
  WallSource source({.depth = [](int frame) -> double {
    if (frame == 10) throw std::runtime_error("a hole in the wall");
    return 0.5;
  }});
  ScriptedDevice device({.hand = pressing_hand});
  auto loop = RunLoop::create(box_tool(), source, device, patient_settings()).value();
  const Status ending = ending_of(*loop);
  ASSERT_FALSE(ending);
  EXPECT_NE(ending.error().message.find("a hole in the wall"), std::string::npos)
      << ending.error().message;
}

/// A wall until it ends, or fails.
class EndingWall final : public DepthSource {
 public:
  std::atomic<bool> has_ended = false, has_failed = false;

  const DepthStreamInfo& info() const override { return wall_.info(); }
  Result<bool> next(DepthFrame& frame) override {
    if (has_failed) return Error{Errc::io_failure, "the wall fell over"};
    if (has_ended) return false;
    return wall_.next(frame);
  }

 private:
  WallSource wall_{{}};
};

struct SeenTicks {
  std::vector<TickRecord> ticks;

  RunObserver observer() {
    RunObserver observer;
    observer.on_ticks = [this](std::span<const TickRecord> records) {
      ticks.insert(ticks.end(), records.begin(), records.end());
    };
    return observer;
  }
};

/// There was a force; from this fault on it only fell, tick by tick, to zero.
void expect_fade(const std::vector<TickRecord>& ticks, Fault fault) {
  const auto is_it = [fault](const TickRecord& tick) { return tick.safety.fault == fault; };
  const auto first = std::ranges::find_if(ticks, is_it);
  ASSERT_NE(first, ticks.end());
  double force = norm(first->F_H_B.force);
  EXPECT_GT(force, 0);
  int num_fading = 0;
  for (auto tick = first; tick != ticks.end(); ++tick) {
    EXPECT_LE(norm(tick->F_H_B.force), force);
    force = norm(tick->F_H_B.force);
    num_fading += force > 0;
  }
  EXPECT_GT(num_fading, 0);
  EXPECT_EQ(force, 0);
}

/// Returns the ending of a run in contact when this becomes true of the wall: the force fades.
Status ending_by(std::atomic<bool> EndingWall::*what, Fault fault) {
  EndingWall source;
  ScriptedDevice device({.hand = pressing_hand});
  SeenTicks seen;
  auto loop =
      RunLoop::create(box_tool(), source, device, patient_settings(), seen.observer()).value();
  if (const Status started = loop->start(); !started) return started;
  EXPECT_TRUE(wait_for([&] { return device.last_force() > 0; }));
  source.*what = true;
  EXPECT_TRUE(wait_for([&] { return !loop->is_running(); }));
  EXPECT_TRUE(wait_for([&] { return device.last_force() == 0; }));
  EXPECT_EQ(loop->report().fault, fault);
  const Status ending = loop->status();
  loop->stop();
  expect_fade(seen.ticks, fault);
  return ending;
}

TEST(LiveLoop, EndsWithItsSource) {
  EXPECT_TRUE(ending_by(&EndingWall::has_ended, Fault::stopped));
  // A source of one frame.
  WallSource single({.num_frames = 1});
  ScriptedDevice other({});
  auto short_loop = RunLoop::create(box_tool(), single, other, patient_settings());
  ASSERT_TRUE((*short_loop)->start());
  EXPECT_TRUE(wait_for([&] { return !(*short_loop)->is_running(); }));
}

TEST(LiveLoop, FadesOutWhenTheSourceFails) {
  const Status ending = ending_by(&EndingWall::has_failed, Fault::sensor);
  ASSERT_FALSE(ending);
  EXPECT_EQ(ending.error().message, "the wall fell over");
}

TEST(LiveLoop, ADeviceThatIsLostIsTheFaultOfItsReport) {
  for (const double lost_after : {0.2, 1e9}) {
    WallSource source({});
    ScriptedDevice device({.hand = pressing_hand, .lost_after = lost_after});
    auto loop = RunLoop::create(box_tool(), source, device, patient_settings());
    ASSERT_TRUE(loop);
    ASSERT_TRUE((*loop)->start());
    if (lost_after < 1) {
      EXPECT_TRUE(wait_for([&] { return !(*loop)->is_running(); }));
    }
    (*loop)->stop();
    EXPECT_EQ((*loop)->report().fault, lost_after < 1 ? Fault::device : Fault::stopped);
  }
}

/// A device that reports the error of its last loss until it has started again.
class DeviceThatWasLost final : public HapticDevice {
 public:
  explicit DeviceThatWasLost(std::function<void()> while_starting)
      : while_starting_(std::move(while_starting)) {}
  const DeviceInfo& info() const override { return device_.info(); }
  Status start(DeviceTick tick) override {
    while_starting_();
    is_lost_ = false;
    return device_.start(std::move(tick));
  }
  void stop() noexcept override { device_.stop(); }
  Status status() const override {
    if (is_lost_) return Error{Errc::unavailable, "lost long ago"};
    return device_.status();
  }

 private:
  const std::function<void()> while_starting_;
  std::atomic<bool> is_lost_ = true;
  ScriptedDevice device_{{.first_tick = 0.3}};
};

// A robot's first pose may take ten seconds. How it was lost before that is no end of this run.
TEST(LiveLoop, ADeviceMayTakeLongToStartAndTheUserIsTold) {
  WallSource source({});
  std::mutex mutex;
  std::vector<std::string> notes;
  RunObserver observer;
  observer.on_note = [&](std::string_view note) {
    const std::lock_guard lock(mutex);
    notes.emplace_back(note);
  };
  const std::string note = "waits for scripted device to start";
  const auto num_told = [&] {
    const std::lock_guard lock(mutex);
    return std::ranges::count(notes, note);
  };
  DeviceThatWasLost device([&] { EXPECT_TRUE(wait_for([&] { return num_told() > 0; })); });
  auto loop = RunLoop::create(box_tool(), source, device, patient_settings(), observer).value();
  const Status started = loop->start();
  EXPECT_TRUE(started) << started.error().message;
  EXPECT_TRUE(loop->is_running());
  loop->stop();
  EXPECT_TRUE(loop->status());
  EXPECT_EQ(num_told(), 1);
}

TEST(LiveLoop, EndsWhenTheDeviceIsLost) {
  WallSource source({});
  ScriptedDevice device({.hand = pressing_hand, .lost_after = 0.2});
  auto loop = RunLoop::create(box_tool(), source, device, patient_settings()).value();
  const Status ending = ending_of(*loop);
  ASSERT_FALSE(ending);
  EXPECT_EQ(ending.error().message, "somebody pulled the plug");
}

// A stuck device may still give its last force, unnoticed by anything else. But a time between
// ticks that the settings allow is no reason to end, whatever time they allow without a state.
TEST(LiveLoop, EndsWhenTheDeviceIsStuck) {
  for (const double allowed : {0.02, 1.2}) {
    WallSource source({});
    ScriptedDevice device({.hand = pressing_hand, .stuck_after = 0.2});
    RunSettings settings = patient_settings();
    settings.safety.max_device_silence = 3600;
    settings.safety.max_tick = allowed;
    auto loop = RunLoop::create(box_tool(), source, device, settings).value();
    const Status ending = ending_of(*loop);
    ASSERT_FALSE(ending);
    EXPECT_NE(ending.error().message.find("does not tick any more"), std::string::npos);
    const auto last = loop->latest();
    ASSERT_TRUE(last);
    EXPECT_GT(loop->report().seconds - last->time, std::max(1.0, allowed));
  }
}

/// Has no memory for its status when it is asked.
class ForgetfulDevice final : public HapticDevice {
 public:
  std::atomic<bool> is_forgetful = false;

  const DeviceInfo& info() const override { return device_.info(); }
  Status start(DeviceTick tick) override { return device_.start(std::move(tick)); }
  void stop() noexcept override { device_.stop(); }
  Status status() const override {
    if (is_forgetful) throw std::bad_alloc();
    return device_.status();
  }
  double last_force() const { return device_.last_force(); }

 private:
  ScriptedDevice device_{{.hand = pressing_hand}};
};

// It is the one that notices the end.
TEST(LiveLoop, AThreadOfRecordsWithoutMemoryEndsTheRunWell) {
  WallSource source({});
  ForgetfulDevice device;
  auto loop = RunLoop::create(box_tool(), source, device, patient_settings()).value();
  ASSERT_TRUE(loop->start());
  ASSERT_TRUE(wait_for([&] { return device.last_force() > 0; }));
  device.is_forgetful = true;
  EXPECT_TRUE(wait_for([&] { return !loop->is_running(); }));
  EXPECT_TRUE(wait_for([&] { return device.last_force() == 0; }));
  loop->stop();
  device.is_forgetful = false;
  const auto last = loop->latest();
  ASSERT_TRUE(last);
  EXPECT_EQ(norm(last->F_H_B.force), 0);  // it has faded
  const Status ending = loop->status();
  ASSERT_FALSE(ending);
  EXPECT_NE(ending.error().message.find("out of memory"), std::string::npos);
}

// The loop does not wait for a time that the device's clock has shown for a moment. The force
// fades, and comes back to a hand that has left the wall and touches it again.
TEST(LiveLoop, ALeapOfTheDevicesClockPasses) {
  WallSource source({});
  std::atomic<bool> is_pressing = true;
  ScriptedDevice device({.hand =
                             [&](double) {
                               return Vec3d{0, 0, is_pressing ? 0.03 : 0.01};
                             },
                         .leaps_after = 0.3});
  std::atomic<Fault> fault = Fault::none;
  RunObserver observer;
  observer.on_ticks = [&](std::span<const TickRecord> ticks) {
    for (const TickRecord& tick : ticks) {
      if (fault == Fault::none) fault = tick.safety.fault;
    }
  };
  auto loop = RunLoop::create(box_tool(), source, device, patient_settings(), observer);
  ASSERT_TRUE(loop);
  ASSERT_TRUE((*loop)->start());
  EXPECT_TRUE(wait_for([&] { return fault != Fault::none; }));
  EXPECT_EQ(fault, Fault::loop);
  EXPECT_TRUE(wait_for([&] { return device.last_force() == 0; }));
  const std::uint64_t before = (*loop)->report().num_contacts;
  const auto begin = std::chrono::steady_clock::now();
  EXPECT_TRUE(wait_for([&] { return (*loop)->report().num_contacts > before + 20; }));
  EXPECT_LT(std::chrono::steady_clock::now() - begin, std::chrono::seconds(30));
  EXPECT_TRUE(wait_for([&] {
    const auto tick = (*loop)->latest();
    return tick && tick->contact_age < 30 && tick->safety.fault == Fault::none;
  }));
  EXPECT_EQ(device.last_force(), 0);  // not into the contact
  is_pressing = false;
  EXPECT_TRUE(wait_for([&] {
    const auto tick = (*loop)->latest();
    return tick && tick->safety.is_engaged();
  }));
  is_pressing = true;
  EXPECT_TRUE(wait_for([&] { return device.last_force() > 0.1; }));
  EXPECT_EQ((*loop)->report().num_faults, 1u);
}

}  // namespace
}  // namespace palpate
