#include "src/cameras/stream/capture_clock.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <functional>
#include <random>
#include <string>
#include <utility>
#include <vector>

#include "src/cameras/stream/frame_intake.h"

namespace palpate {
namespace {

struct Errors {
  double largest = 0, mean = 0;
};

/// A camera whose clock is `offset` off and drifts, and whose frames take `delay` and more.
Errors errors_after(double seconds, double from, double drift, double mean_delay,
                    double* found_drift = nullptr) {
  std::mt19937 random(7);
  std::exponential_distribution<double> more(1 / mean_delay);
  CaptureClock clock;
  Errors errors;
  int num = 0;
  for (int k = 0; k / 30.0 < seconds; ++k) {
    const double captured = 1000 + k / 30.0;                     // on our clock
    const double stamp = 5e5 + (1 + drift) * (captured - 1000);  // on the camera's
    const double arrival = captured + 0.004 + more(random);
    const double estimate = clock.add(stamp, arrival);
    EXPECT_LE(estimate, arrival);
    if (k / 30.0 < from) continue;
    // The smallest delay cannot be known from outside.
    const double error = estimate - (captured + 0.004);
    errors.largest = std::max(errors.largest, std::abs(error));
    errors.mean += error;
    ++num;
  }
  errors.mean /= num;
  if (found_drift != nullptr) *found_drift = clock.drift();
  return errors;
}

TEST(CaptureClock, FindsTheOffsetThroughJitter) {
  const Errors errors = errors_after(20, 2, 0, 0.005);
  EXPECT_LT(errors.largest, 0.0012);
}

TEST(CaptureClock, FollowsADriftForAnHour) {
  double drift = 0;
  const Errors errors = errors_after(3600, 60, 80e-6, 0.005, &drift);
  EXPECT_LT(errors.largest, 0.0012);
  EXPECT_NEAR(drift, 80e-6, 30e-6);
  EXPECT_LT(errors_after(600, 60, -150e-6, 0.005).largest, 0.0012);
}

TEST(CaptureClock, BeginsAnewWithTheCamera) {
  CaptureClock clock;
  for (int k = 0; k < 100; ++k) clock.add(500 + k / 30.0, 1000 + k / 30.0);
  EXPECT_EQ(clock.num_restarts(), 0);
  EXPECT_NEAR(clock.add(0.1, 1004), 1004, 1e-9);
  EXPECT_EQ(clock.num_restarts(), 1);
  EXPECT_NEAR(clock.add(0.2, 1004.13), 1004.1, 1e-9);
}

TEST(CaptureClock, OneLateFrameMovesNothing) {
  CaptureClock clock;
  for (int k = 0; k < 100; ++k) clock.add(k / 30.0, 1000 + k / 30.0);
  EXPECT_NEAR(clock.add(100 / 30.0, 1000 + 100 / 30.0 + 0.5), 1000 + 100 / 30.0, 1e-9);
  EXPECT_NEAR(clock.add(101 / 30.0, 1000 + 101 / 30.0 + 3), 1000 + 101 / 30.0, 2e-4);
  EXPECT_EQ(clock.num_restarts(), 0);
}

/// Disturbance of a camera of 30 frames per second within two minutes, from the 40th second on:
/// errors of its clock and delays of its frames. Times are of our clock, s.
struct Mishap {
  std::string name;
  std::function<double(double captured, int frame)> error;  // s, of its clock
  std::function<double(double captured)> late;  // s, beside a small delay; frames keep their order
  double too_old = 0.12;                        // s: largest excess of a frame's age ...
  double healed = 5;     // s: ... from then on, by our clock; unlimited before
  int num_restarts = 0;  // at most
  double known = 5;      // s: from then on late frames are recognized
};

constexpr double kBegin = 40, kRate = 30;
constexpr int kWild = static_cast<int>(kBegin * kRate);

// A frame must never look newer than it is: the force would be that of a scene that is gone. If it
// looks older than it is, this costs the force, which may last for moments only.
TEST(CaptureClock, KnowsALateFrameFromAClockThatWasSet) {
  const auto right = [](double, int) { return 0.0; };
  const auto on_time = [](double) { return 0.0; };
  const auto slewed = [](double rate, double seconds) {
    return [=](double t, int) { return rate * std::clamp(t - kBegin, 0.0, seconds); };
  };
  const auto grows = [](double rate, double seconds, double after) {
    return
        [=](double t) { return t > kBegin + seconds ? after : rate * std::max(t - kBegin, 0.0); };
  };
  std::vector<Mishap> mishaps{
      {"none", right, on_time},
      {"always late", right, [](double) { return 0.3; }},
      {"ever later, and then on time", right, grows(0.3, 20, 0)},
      {"slowly later for a minute", right, grows(0.01, 60, 0)},
      {"later, and then as late as before", right, grows(0.1, 30, 3)},
      {"a stall, and what it held at once", right,
       [](double t) { return t > kBegin && t < kBegin + 3 ? kBegin + 3 - t : 0; }},
      {"ten seconds late at first", right, [](double t) { return t < 10 ? 10 - t : 0; }, 0.12, 12,
       0, 12},
      {"a clock that is slewed by NTP", slewed(500e-6, 60), on_time},
      {"the same backwards", slewed(-500e-6, 60), on_time},
      {"a clock that is slewed fast", slewed(0.083, 6), on_time},
      // Indistinguishable from frames that come later and later.
      {"the same backwards", slewed(-0.083, 6), on_time, 0.6},
      {"a camera that starts again",
       [](double t, int) { return t < kBegin ? 0 : -5e4 - 1000 - kBegin; }, on_time, 0.12,
       kBegin + 0.2, 1},
  };
  for (const double by : {0.01, 0.05, 0.1, 0.3, 0.6, 0.99, 1.01, 3.0, 3600.0, 86400.0}) {
    for (const double sign : {-1, 1}) {
      const auto set = [=](double t, int) { return t < kBegin ? 0 : sign * by; };
      const auto wild = [=](double, int frame) { return frame == kWild ? sign * by : 0; };
      const std::string text = std::to_string(sign * by) + " s";
      mishaps.push_back({"a clock set by " + text, set, on_time, 0.12, kBegin + 0.2, 1});
      mishaps.push_back({"one stamp wrong by " + text, wild, on_time, 0.12, kBegin + 0.2, 2});
    }
  }
  for (const Mishap& mishap : mishaps) {
    SCOPED_TRACE(mishap.name);
    std::mt19937 random(7);
    std::exponential_distribution<double> more(1 / 0.003);
    StampOrder order;
    CaptureClock clock;
    double arrival = 0, last_used = 0, longest_without = 0, too_new = 0, too_old = 0;
    for (int k = 0; k < 120 * kRate; ++k) {
      const double t = k / kRate, captured = 1000 + t, earliest = captured + 0.02 + mishap.late(20);
      arrival = std::max(arrival + 1e-4, captured + 0.02 + mishap.late(t) + more(random));
      const double stamp = captured + 5e4 + mishap.error(t, k);
      const bool is_used = order.add(stamp, arrival) != StampOrder::Step::older;
      const double looks = clock.add(stamp, arrival);
      EXPECT_LE(looks, arrival);
      if (!is_used || t < mishap.known) continue;
      longest_without = std::max(longest_without, t - std::exchange(last_used, t));
      const double drift = 1e-3 * std::max(t - kBegin, 0.0);  // that may be
      too_new = std::max(too_new, looks - earliest - drift);
      if (arrival - 1000 > mishap.healed) too_old = std::max(too_old, earliest - looks);
    }
    EXPECT_LT(too_new, 0.03);
    EXPECT_LT(too_old, mishap.too_old);
    EXPECT_LT(longest_without, 0.15 + mishap.known);
    EXPECT_LE(clock.num_restarts(), mishap.num_restarts);
  }
}

// Frames that are sent a second time come faster than a clock goes.
TEST(CaptureClock, WhatIsSentAgainIsOld) {
  StampOrder order;
  CaptureClock clock;
  for (int k = 0; k < 100; ++k) clock.add(0.01 * k, 1000 + 0.01 * k);
  for (int k = 0; k < 100; ++k) order.add(0.01 * k, 1000 + 0.01 * k);
  for (int k = 50; k < 100; ++k) {
    const double arrival = 1001 + 0.0005 * k;
    EXPECT_EQ(order.add(0.01 * k, arrival), StampOrder::Step::older);
    EXPECT_NEAR(clock.add(0.01 * k, arrival), 1000 + 0.01 * k, 1e-9);
  }
  EXPECT_EQ(clock.num_restarts(), 0);
}

/// Ages and notes of 8 x 8 frames with given stamps and arrival times.
struct Taken {
  std::vector<double> ages;  // s, when each has come
  std::string notes;
};
Taken taken(StampClock stamps, const std::vector<std::pair<double, double>>& stamps_and_arrivals) {
  FrameIntake::Options options;
  options.pinhole = {8, 8, {8, 8, 3.5, 3.5}, {}};
  options.stamps = stamps;
  FrameIntake intake(options);
  Taken taken;
  for (const auto& [stamp, arrival] : stamps_and_arrivals) {
    DepthFrame frame{8, 8, 0.001, std::vector<std::uint16_t>(64, 1000), stamp};
    intake.give(frame, options.pinhole, arrival);
    EXPECT_TRUE(*intake.next(frame));
    taken.ages.push_back(arrival - frame.timestamp);
  }
  for (const std::string& note : intake.take_notes()) taken.notes += note + "\n";
  return taken;
}

TEST(FrameIntake, FramesThatAreLateAreOldAndToldOf) {
  std::vector<std::pair<double, double>> frames;
  for (int k = 0; k < 100; ++k) frames.push_back({k / kRate, 1000 + k / kRate});
  for (int k = 100; k < 200; ++k) frames.push_back({k / kRate, 1000 + k / kRate + 3});
  const auto [ages, notes] = taken(StampClock::cameras, frames);
  EXPECT_NEAR(ages[99], 0, 1e-9);
  EXPECT_NEAR(ages[100], 3, 1e-3);
  EXPECT_NEAR(ages[199], 3, 0.01);
  EXPECT_EQ(notes.find("restarted"), std::string::npos) << notes;
  EXPECT_NE(notes.find("3.0 s late"), std::string::npos) << notes;
  EXPECT_EQ(std::count(notes.begin(), notes.end(), '\n'), 1) << notes;
}

TEST(FrameIntake, OurClockIsBelievedOnceItFits) {
  const auto frames = [](const std::function<double(int)>& stamp) {
    std::vector<std::pair<double, double>> all;
    for (int k = 0; k < 40; ++k) all.push_back({stamp(k), 1000 + 0.1 * k});
    return all;
  };
  // Buffers of a driver that were filled before the program stood still for two seconds.
  auto late = frames([](int k) { return 999.98 + 0.1 * k; });
  for (std::size_t k = 20; k < late.size(); ++k) late[k].second += k < 24 ? 2 : 0;
  for (std::size_t k = 24; k < late.size(); ++k) late[k] = {late[k].first + 2, late[k].second + 2};
  Taken seen = taken(StampClock::ours, late);
  EXPECT_NEAR(seen.ages[19], 0.02, 1e-9);
  for (std::size_t k = 20; k < 24; ++k) EXPECT_NEAR(seen.ages[k], 2.02, 1e-9);
  EXPECT_NEAR(seen.ages[24], 0.02, 1e-9);
  EXPECT_EQ(seen.notes.find("not of this computer's clock"), std::string::npos) << seen.notes;
  // Another clock, which a note reports once it is certain.
  seen = taken(StampClock::ours, frames([](int k) { return 5 + 0.1 * k; }));
  for (const double age : seen.ages) EXPECT_NEAR(age, 0, 1e-9);
  EXPECT_NE(seen.notes.find("not of this computer's clock"), std::string::npos) << seen.notes;
  // Clocks that are kept together are never quite the same.
  seen = taken(StampClock::shared, frames([](int k) { return 1000.0001 + 0.1 * k; }));
  EXPECT_EQ(seen.notes, "");
  seen = taken(StampClock::shared, frames([](int k) { return 1000.5 + 0.1 * k; }));
  EXPECT_NE(seen.notes.find("not of this computer's clock"), std::string::npos) << seen.notes;
}

}  // namespace
}  // namespace palpate
