// Frames on their way from a camera's driver: clocks, notes, and what is not plausible.
#include "src/cameras/stream/frame_intake.h"

#include <gtest/gtest.h>

#include <cmath>
#include <functional>
#include <iterator>
#include <limits>
#include <numbers>
#include <string>

#include "src/cameras/internal/plausibility.h"
#include "src/core/internal/monotonic_clock.h"
#include "tests/cameras/conformance.h"
#include "tests/cameras/small_camera.h"

namespace palpate {
namespace {

using test::has;
using test::joined;
using test::kHeight;
using test::kWidth;
using test::stream_info;

/// A clock that is declared as synchronized with ours is set: back by ten seconds, forward by ten,
/// and right.
TEST(FrameIntake, GoesOnWhenASharedClockIsSet) {
  struct Case {
    std::vector<double> by;  // s, of each frame: error of its clock
    double age;              // s, of the last frame
    int num_notes;           // of a clock that was set back
  };
  for (const Case& one : {Case{{0, 0, -10, -10, -10}, 0.25, 1}, Case{{0, 0, -10, -10, 0}, 0.02, 1},
                          Case{{0, 0, 10, 10, 0}, 0.02, 1}, Case{{0, 0, 0, 0, -0.5}, 0.12, 0}}) {
    FrameIntake::Options options;
    options.pinhole = {kWidth, kHeight, {60, 60, 15.5, 11.5}, {}};
    options.stamps = StampClock::shared;
    FrameIntake intake(options);
    double now = 1000;
    int number = 0;
    for (const double by : one.by) {
      now += 0.1;
      DepthFrame frame = test::pattern_frame(kWidth, kHeight, number++, now - 0.02 + by);
      intake.give(frame, options.pinhole, now);
    }
    intake.end(false);
    DepthFrame frame;
    ASSERT_TRUE(*intake.next(frame));
    // Half a second back is taken for a frame from the past.
    EXPECT_EQ(test::number_of(frame, 10), one.num_notes == 0 ? 3 : 4);
    // Time stamps never decrease: a frame that looks older than the last one gets its time.
    EXPECT_NEAR(now - frame.timestamp, one.age, 0.1001);
    const std::string notes = joined(intake.take_notes());
    EXPECT_EQ(has(notes, "has restarted its clock"), one.num_notes == 1) << notes;
  }
}

// A camera whose every frame is another one's: nobody could read so many notes, and a run of hours
// would keep all of them.
TEST(FrameIntake, WhatHappensWithEveryFrameIsToldTenTimesAndThenCounted) {
  FrameIntake::Options options;
  options.pinhole = {kWidth, kHeight, {60, 60, 15.5, 11.5}, {}};
  options.stamps = StampClock::cameras;
  FrameIntake intake(options);
  const auto count = [](const std::string& text, const std::string& what) {
    int num = 0;
    for (auto at = text.find(what); at != std::string::npos; at = text.find(what, at + 1)) ++num;
    return num;
  };
  std::string notes;
  for (int k = 0; k < 50; ++k) {
    CameraModel model = options.pinhole;
    model.intrinsics.fx += k % 2;
    DepthFrame frame = test::pattern_frame(kWidth, kHeight, k, 1e5 * (k % 2) + k);
    intake.give(frame, model, 1000 + 0.1 * k);
    notes += joined(intake.take_notes());
  }
  EXPECT_EQ(count(notes, "has restarted its clock"), 10) << notes;
  EXPECT_EQ(count(notes, "has changed its intrinsics"), 10) << notes;
  EXPECT_EQ(count(notes, "from now on, that is only counted"), 2) << notes;
  intake.cancel();
  const std::string last = joined(intake.take_notes());
  EXPECT_TRUE(has(last,
                  "; 48 times, its clock was restarted; 49 times, image, intrinsics or unit "
                  "changed; "))
      << last;
}

// A clock in another unit, or none at all: no time can be had of it but that of the arrival.
TEST(FrameIntake, TimeStampsThatAreNoSecondsAreNotUsed) {
  constexpr int kNum = 20;
  constexpr double kInf = std::numeric_limits<double>::infinity();
  const std::function<double(int)> stamps[] = {
      [](int) { return 1e308; },
      [](int k) { return k % 2 == 0 ? -1e308 : 1e308; },
      [](int k) { return 1.7e18 + 1e8 * k; },  // in nanoseconds
      [](int k) { return 1.7e12 + 100 * k; },  // in milliseconds
      [](int) { return kInf; },
      [](int) { return std::numeric_limits<double>::quiet_NaN(); },
  };
  const char* const told[] = {"1e+308", "-1e+308", "1.7e+18", "1.7e+12", "inf", "nan"};
  for (const StampClock clock : {StampClock::cameras, StampClock::ours, StampClock::shared}) {
    for (std::size_t which = 0; which < std::size(stamps); ++which) {
      SCOPED_TRACE(told[which]);
      FrameIntake::Options options;
      options.pinhole = {kWidth, kHeight, {60, 60, 15.5, 11.5}, {}};
      options.stamps = clock;
      options.latency = 0.01;
      FrameIntake intake(options);
      for (int k = 0; k < kNum; ++k) {
        const double now = 1000 + 0.1 * k;
        DepthFrame frame = test::pattern_frame(kWidth, kHeight, k, stamps[which](k));
        intake.give(frame, options.pinhole, now);
        if (k + 1 < kNum) continue;
        intake.end(false);
        ASSERT_TRUE(*intake.next(frame));
        EXPECT_EQ(test::number_of(frame, kNum), k);
        EXPECT_NEAR(frame.timestamp, now - 0.01, 1e-12);
      }
      intake.cancel();
      const std::string notes = joined(intake.take_notes());
      EXPECT_TRUE(has(notes, std::string("has time stamps that are no seconds, such as ") +
                                 told[which] + "; these frames count as captured when they arrive"))
          << notes;
      EXPECT_TRUE(has(notes, "20 had time stamps that are no seconds\n")) << notes;
      EXPECT_FALSE(has(notes, "restarted")) << notes;
      EXPECT_FALSE(has(notes, "old timestamps")) << notes;
    }
  }
}

TEST(FrameIntake, OneTimeStampThatIsNoSecondsSpoilsNoOther) {
  FrameIntake::Options options;
  options.pinhole = {kWidth, kHeight, {60, 60, 15.5, 11.5}, {}};
  options.rate = 10;
  options.stamps = StampClock::cameras;
  FrameIntake intake(options);
  for (int k = 0; k < 20; ++k) {
    const bool is_wrong = k % 5 == 0;  // the first one too
    const double capture = 1000 + 0.1 * k, late = k % 2 == 0 ? 0 : 0.03;
    DepthFrame frame =
        test::pattern_frame(kWidth, kHeight, k, is_wrong ? 1.7e18 : capture - 1000 - 30);
    intake.give(frame, options.pinhole, capture + late);
    ASSERT_TRUE(*intake.next(frame));
    EXPECT_EQ(test::number_of(frame, 20), k);
    // The clock of the good time stamps is known from the third frame on.
    if (k < 2) continue;
    EXPECT_NEAR(frame.timestamp, capture + (is_wrong ? late : 0), 1e-9) << k;
  }
  intake.cancel();
  const std::string notes = joined(intake.take_notes());
  EXPECT_TRUE(has(notes,
                  "has sent 20 frames; 4 had time stamps that "
                  "are no seconds; capture times are from its clock"))
      << notes;
  EXPECT_FALSE(has(notes, "restarted")) << notes;
}

TEST(Plausibility, DoubtsUnitsAndIntrinsicsThatCannotBe) {
  const CameraModel model{
      kWidth * 4, kHeight * 4, stream_info(kWidth * 4, kHeight * 4).intrinsics, {}};
  DepthFrame good = test::pattern_frame(kWidth * 4, kHeight * 4, 0, 0);
  EXPECT_EQ(Plausibility().look(good, model), "");
  // Millimeters in counts of 1/5000 m, read as millimeters.
  DepthFrame fivefold = good;
  for (auto& count : fivefold.pixels) count = static_cast<std::uint16_t>(5 * count);
  EXPECT_EQ(common_divisor(fivefold), 5);
  EXPECT_EQ(common_divisor(good), 1);
  EXPECT_TRUE(has(Plausibility().look(fivefold, model), "unit=0.0002"));
  fivefold.unit = 0.0002;
  EXPECT_EQ(Plausibility().look(fivefold, model), "");
  DepthFrame tenfold = good;
  tenfold.unit = 0.01;
  EXPECT_TRUE(has(Plausibility().look(tenfold, model), "the right unit?"));
  CameraModel wrong = model;
  wrong.intrinsics = {256, 256, 127.5, 95.5};  // of 256 x 192 pixels
  EXPECT_TRUE(has(Plausibility().look(good, wrong), "128,128,63.5,47.5"));
  CameraModel narrow = model;  // focal lengths in other units
  narrow.intrinsics.fx *= 10;
  narrow.intrinsics.fy *= 10;
  const double degrees =
      2 * std::atan2(0.5 * model.width, narrow.intrinsics.fx) * 180 / std::numbers::pi;
  EXPECT_LT(degrees, 15);
  EXPECT_TRUE(has(Plausibility().look(good, narrow),
                  "field of view of " + std::to_string(std::lround(degrees)) + " degrees"));
  // Images of points have the camera that was made for them, and scanners see far.
  EXPECT_EQ(Plausibility().look(good, narrow, true), "");
  EXPECT_EQ(Plausibility().look(tenfold, model, true), "");
  tenfold.unit = 1;  // millimeters, read as meters
  EXPECT_TRUE(has(Plausibility().look(tenfold, model, true), "give scale=METERS"));
}

TEST(Plausibility, DoubtsPointsThatAreNotInMeters) {
  const auto doubt = [](float meters, int width) {
    PointCloud cloud(width, 10);
    for (std::size_t i = 0; i + 1 < cloud.size(); ++i) {  // the last one is invalid
      cloud.set(i, {0, 0.001f * meters * static_cast<float>(i % 10), meters}, {0, 0, -1});
    }
    return doubt_points(cloud.view());
  };
  for (const float usual : {0.2f, 0.5f, 150.0f}) EXPECT_EQ(doubt(usual, 20), "") << usual;
  EXPECT_TRUE(has(doubt(500, 20), "its points are 500 m away in the middle: are they in meters?"));
  EXPECT_TRUE(has(doubt(500, 20), "--camera 'folder:FOLDER?scale=METERS'"));
  EXPECT_TRUE(has(doubt(0.0005f, 20), "0.0005 m away"));
  EXPECT_EQ(doubt(500, 5), "");  // too few to tell
}

}  // namespace
}  // namespace palpate
