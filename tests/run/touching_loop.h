// A loop that presses into a wall, and everything that its observer gets.
#pragma once

#include <gtest/gtest.h>

#include <chrono>
#include <cmath>
#include <memory>
#include <mutex>
#include <span>
#include <thread>
#include <utility>
#include <vector>

#include "tests/run/live_loop_fixtures.h"

namespace palpate::test::touching_loop {

/// Forces that nothing but the slew limit and the device bends.
inline RunSettings patient_settings() {
  RunSettings settings = test::patient_settings();
  settings.safety.passivity_control = false;
  return settings;
}

/// The box is 5 to 15 mm in the wall, at 20 mm/s at most.
inline Vec3d pressing_hand(double time) { return {0, 0, 0.035 + 0.005 * std::sin(4 * time)}; }

struct SeenFrameCopy {
  std::uint32_t revision;
  double time;
  DepthFrame frame;
};

/// Everything that an observer gets, with checks that settings come before their results.
struct Seen {
  std::mutex mutex;
  std::vector<SeenFrameCopy> frames;
  std::vector<ContactRecord> contacts;
  std::vector<TickRecord> ticks;
  std::vector<RunSettings> settings;

  RunObserver observer() {
    RunObserver observer;
    observer.on_settings = [this](std::uint32_t revision, const RunSettings& now) {
      const std::lock_guard lock(mutex);
      settings.push_back(now);
      EXPECT_EQ(revision, settings.size());
    };
    observer.on_frame = [this](const FrameRecord& record, const DepthFrame& frame) {
      const std::lock_guard lock(mutex);
      EXPECT_LE(record.revision, settings.size());
      frames.push_back({record.revision, record.capture_time, frame});
    };
    observer.on_contact = [this](const ContactRecord& contact) {
      const std::lock_guard lock(mutex);
      EXPECT_LE(contact.revision, settings.size());
      contacts.push_back(contact);
    };
    observer.on_ticks = [this](std::span<const TickRecord> records) {
      const std::lock_guard lock(mutex);
      EXPECT_LE(records.back().revision, settings.size());
      ticks.insert(ticks.end(), records.begin(), records.end());
    };
    return observer;
  }
  std::size_t num_frames() {
    const std::lock_guard lock(mutex);
    return frames.size();
  }
};

/// A loop that presses into a wall.
struct Touching {
  explicit Touching(WallSource::Options wall = {}, RunSettings settings = patient_settings())
      : source(std::move(wall)), device({.hand = pressing_hand}) {
    loop = RunLoop::create(box_tool(), source, device, settings, seen.observer()).value();
    EXPECT_TRUE(loop->start());
    EXPECT_TRUE(wait_for([&] { return loop->report().num_contacts > 20; }));
  }
  void run_for(double seconds) {
    std::this_thread::sleep_for(std::chrono::duration<double>(seconds));
  }

  WallSource source;
  ScriptedDevice device;
  Seen seen;
  std::unique_ptr<RunLoop> loop;
};

}  // namespace palpate::test::touching_loop
