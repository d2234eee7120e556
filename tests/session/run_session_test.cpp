#include <gtest/gtest.h>

#include "palpate/session/session.h"
#include "src/session/run_files.h"
#include "tests/session/synthetic_stream.h"

namespace palpate {
namespace {

using test::SyntheticStream;

const PoseFunction kPath = [](std::size_t, double time) { return test::pressing_pose(time); };

RunSettings settings_with(int num_threads, InsideMethod method = InsideMethod::simplified) {
  RunSettings settings;
  settings.rate = 500;
  settings.num_threads = num_threads;
  settings.contact.method = method;
  return settings;
}

TEST(RunSession, SameNumbersTwiceAndForAnyNumberOfThreads) {
  const Tool tool = test::small_tool();
  for (const InsideMethod method :
       {InsideMethod::weighted, InsideMethod::simplified, InsideMethod::graph}) {
    std::string first;
    for (const int num_threads : {1, 1, 2, 3}) {
      SyntheticStream stream(6);
      const auto log = run_session(tool, stream, kPath, settings_with(num_threads, method));
      ASSERT_TRUE(log) << log.error().message;
      const std::string csv = wrench_csv(tool, *log);
      if (first.empty()) first = csv;
      EXPECT_EQ(csv, first);
      EXPECT_GT(log->ticks[log->deepest_tick].penetration.volume, 0);
    }
  }
}

TEST(RunSession, FramesBecomeCurrentAtTheirTime) {
  const Tool tool = test::small_tool();
  SyntheticStream stream(4, 32);  // time stamps without rounding
  const auto log = run_session(tool, stream, kPath, settings_with(1));
  ASSERT_TRUE(log) << log.error().message;
  ASSERT_EQ(log->frames.size(), 4u);
  // Four frames at 32 Hz last 125 ms: at 500 Hz, ticks 0 ... 62.
  EXPECT_EQ(log->ticks.size(), 63u);
  for (const TickRecord& tick : log->ticks) {
    EXPECT_EQ(tick.frame, static_cast<int>(tick.time * 32)) << tick.time;
  }
}

TEST(RunSession, SlowTicksSkipFrames) {
  const Tool tool = test::small_tool();
  SyntheticStream stream(32, 32);
  RunSettings settings = settings_with(1);
  settings.rate = 8;
  std::size_t num_seen = 0;
  RunCallbacks callbacks;
  callbacks.on_frame = [&](std::size_t index, double time, const DepthFrame&) -> Status {
    EXPECT_EQ(index, num_seen++);
    EXPECT_NEAR(time, static_cast<double>(index) / 8, 1e-9);
    return Done{};
  };
  const auto log = run_session(tool, stream, kPath, settings, callbacks);
  ASSERT_TRUE(log) << log.error().message;
  EXPECT_EQ(log->ticks.size(), 8u);
  EXPECT_EQ(num_seen, 8u);
}

TEST(RunSession, DurationIsExactAndTheLastFrameStays) {
  const Tool tool = test::small_tool();
  SyntheticStream stream(2);
  RunSettings settings = settings_with(1);
  settings.duration = 0.3;
  settings.end_with_source = false;
  const auto log = run_session(tool, stream, kPath, settings);
  ASSERT_TRUE(log) << log.error().message;
  EXPECT_EQ(log->ticks.size(), 150u);
  EXPECT_EQ(log->ticks.back().frame, 1);
}

TEST(RunSession, DeepestMomentIsTheLargestVolumeWithItsFrame) {
  const Tool tool = test::small_tool();
  SyntheticStream stream(6);
  const auto log = run_session(tool, stream, kPath, settings_with(1));
  ASSERT_TRUE(log) << log.error().message;
  const TickRecord& deepest = log->ticks[log->deepest_tick];
  for (const TickRecord& tick : log->ticks) {
    EXPECT_LE(tick.penetration.volume, deepest.penetration.volume);
  }
  EXPECT_NEAR(log->deepest_frame.timestamp, 1000.25 + deepest.frame / 30.0, 1e-9);
}

TEST(RunSession, StopsWhenAsked) {
  const Tool tool = test::small_tool();
  SyntheticStream stream(6);
  RunCallbacks callbacks;
  callbacks.on_tick = [](const TickRecord& tick) { return tick.time < 0.01; };
  const auto log = run_session(tool, stream, kPath, settings_with(1), callbacks);
  ASSERT_TRUE(log) << log.error().message;
  EXPECT_TRUE(log->interrupted);
  EXPECT_EQ(log->ticks.size(), 6u);
}

TEST(RunSession, FaultsAreErrors) {
  const Tool tool = test::small_tool();
  {
    SyntheticStream stream(6);
    stream.fail_at = 3;
    const auto log = run_session(tool, stream, kPath, settings_with(1));
    ASSERT_FALSE(log);
    EXPECT_NE(log.error().message.find("frame 3"), std::string::npos);
  }
  {
    SyntheticStream stream(6);
    stream.resize_at = 2;
    const auto log = run_session(tool, stream, kPath, settings_with(1));
    ASSERT_FALSE(log);
    EXPECT_NE(log.error().message.find("frame 2"), std::string::npos) << log.error().message;
  }
  {
    SyntheticStream stream(0);
    EXPECT_FALSE(run_session(tool, stream, kPath, settings_with(1)));
  }
  for (const auto& break_it :
       {+[](RunSettings& s) { s.rate = 0; }, +[](RunSettings& s) { s.rate = NAN; },
        +[](RunSettings& s) { s.duration = -1; }, +[](RunSettings& s) { s.duration = 1e9; },
        +[](RunSettings& s) { s.num_threads = -1; },
        +[](RunSettings& s) { s.surface.normals.radius = 1000; }}) {
    SyntheticStream stream(6);
    RunSettings settings = settings_with(1);
    break_it(settings);
    const auto log = run_session(tool, stream, kPath, settings);
    ASSERT_FALSE(log);
    EXPECT_EQ(log.error().code, Errc::invalid_argument) << log.error().message;
  }
}

TEST(RunSession, NonFinitePoseMeasuresNothing) {
  const Tool tool = test::small_tool();
  SyntheticStream stream(2);
  const PoseFunction path = [](std::size_t tick, double time) {
    Pose pose = test::pressing_pose(time);
    if (tick == 3) pose.translation.x = NAN;
    return pose;
  };
  const auto log = run_session(tool, stream, path, settings_with(1));
  ASSERT_TRUE(log) << log.error().message;
  EXPECT_EQ(log->ticks[3].penetration.volume, 0);
  EXPECT_NE(log->ticks[3].penetration.status.bits, 0u);
}

}  // namespace
}  // namespace palpate
