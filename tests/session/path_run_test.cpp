// Runs along a path: when frames become current, when they end, and that they repeat.
#include <gtest/gtest.h>

#include "src/session/internal/run_messages.h"
#include "tests/session/path_run.h"
#include "tests/session/synthetic_stream.h"

namespace palpate {
namespace {

using test::path_settings;
using test::pressing_pose;
using test::run_path;
using test::SyntheticStream;

void expect_same(const std::vector<TickRecord>& a, const std::vector<TickRecord>& b) {
  ASSERT_EQ(a.size(), b.size());
  for (std::size_t k = 0; k < a.size(); ++k) ASSERT_EQ(difference(a[k], b[k]), "") << k;
}

TEST(PathRun, SameNumbersTwiceAndForAnyNumberOfThreads) {
  const Tool tool = test::small_tool();
  for (const MethodKind method :
       {MethodKind::weighted, MethodKind::simplified, MethodKind::graph, MethodKind::field}) {
    for (const CouplingKind kind : {CouplingKind::none, CouplingKind::virtual_coupling}) {
      std::vector<TickRecord> first;
      for (const int num_threads : {1, 1, 2, 3}) {
        SyntheticStream stream(6);
        RunSettings settings = path_settings(500);
        settings.num_threads = num_threads;
        settings.contact.method = method;
        settings.coupling.kind = kind;
        const auto log = run_path(tool, stream, pressing_pose, settings);
        ASSERT_TRUE(log) << log.error().message;
        if (first.empty()) first = log->ticks;
        expect_same(log->ticks, first);
        EXPECT_GT(log->ticks[log->deepest_tick].penetration.volume, 0);
      }
    }
  }
}

TEST(PathRun, FramesBecomeCurrentAtTheirTime) {
  const Tool tool = test::small_tool();
  SyntheticStream stream(4, 32);  // time stamps without rounding
  const auto log = run_path(tool, stream, pressing_pose, path_settings(500));
  ASSERT_TRUE(log) << log.error().message;
  ASSERT_EQ(log->frames.size(), 4u);
  EXPECT_EQ(log->frames[2].source_time, 1000.25 + 2 / 32.0);
  EXPECT_EQ(log->frames[2].capture_time, 2 / 32.0);
  // Four frames at 32 Hz last 125 ms: at 500 Hz, ticks 0 ... 62.
  EXPECT_EQ(log->ticks.size(), 63u);
  EXPECT_EQ(log->report.ending, "the depth frames have ended");
  EXPECT_EQ(log->report.fault, Fault::none);
  for (const TickRecord& tick : log->ticks) {
    EXPECT_EQ(tick.frame_number, static_cast<std::uint64_t>(tick.time * 32)) << tick.time;
  }
}

TEST(PathRun, SlowTicksSkipFrames) {
  const Tool tool = test::small_tool();
  SyntheticStream stream(32, 32);
  const auto log = run_path(tool, stream, pressing_pose, path_settings(8));
  ASSERT_TRUE(log) << log.error().message;
  EXPECT_EQ(log->ticks.size(), 8u);
  ASSERT_EQ(log->frames.size(), 8u);
  for (std::size_t i = 0; i < 8; ++i) {
    EXPECT_EQ(log->frames[i].number, i);
    EXPECT_NEAR(log->frames[i].capture_time, static_cast<double>(i) / 8, 1e-9);
  }
}

TEST(PathRun, DurationIsExactAndTheLastFrameStays) {
  const Tool tool = test::small_tool();
  SyntheticStream stream(2);
  const auto log = run_path(tool, stream, pressing_pose, path_settings(500), 0.3);
  ASSERT_TRUE(log) << log.error().message;
  EXPECT_EQ(log->ticks.size(), 150u);
  EXPECT_EQ(log->ticks.back().frame_number, 1u);
  EXPECT_EQ(log->report.ending, "the path has ended");
}

// Frames that carry the same clock as the path are taken at their word.
TEST(PathRun, ZeroIsWhereTheClockSays) {
  const Tool tool = test::small_tool();
  SyntheticStream stream(6, 32);
  auto device = test::path_device(pressing_pose, 500);
  ASSERT_TRUE(device);
  std::vector<TickRecord> ticks;
  RunObserver observer;
  observer.on_ticks = [&](std::span<const TickRecord> some) { ticks.push_back(some[0]); };
  SimulatedClock clock;
  clock.zero = 1000.25 + 2.5 / 32;
  auto loop = RunLoop::simulate(tool, stream, **device, path_settings(500), clock, observer);
  ASSERT_TRUE(loop);
  ASSERT_TRUE((*loop)->start());
  while ((*loop)->is_running()) std::this_thread::sleep_for(std::chrono::milliseconds(1));
  (*loop)->stop();
  ASSERT_FALSE(ticks.empty());
  // The third frame is half a period old when the run begins; the ones before it are left out.
  EXPECT_EQ(ticks.front().frame_number, 0u);
  EXPECT_EQ(ticks.front().sensor_age, 0.5 / 32);
  EXPECT_EQ(ticks.size(), static_cast<std::size_t>(std::ceil(500 * 3.5 / 32)));
}

// Ticks come at the device's rate: a contact rate that would change nothing is refused.
TEST(PathRun, AnotherContactRateIsRefusedMeanwhile) {
  const Tool tool = test::small_tool();
  SyntheticStream stream(300);
  auto device = test::path_device(pressing_pose, 500);
  ASSERT_TRUE(device);
  SimulatedClock clock;
  clock.keeps_pace = true;
  auto loop = RunLoop::simulate(tool, stream, **device, path_settings(500), clock);
  ASSERT_TRUE(loop);
  ASSERT_TRUE((*loop)->start());
  RunSettings settings = (*loop)->settings();
  settings.contact_rate = 250;
  const Status refused = (*loop)->change(settings);
  ASSERT_FALSE(refused);
  EXPECT_NE(refused.error().message.find("loop.contact_rate"), std::string::npos);
  settings.contact_rate = 500;
  settings.contact.method = MethodKind::graph;
  EXPECT_TRUE((*loop)->change(settings));
  (*loop)->stop();
}

TEST(PathRun, FaultsAreErrors) {
  const Tool tool = test::small_tool();
  const auto message = [&](SyntheticStream stream, const RunSettings& settings) {
    const auto log = run_path(tool, stream, pressing_pose, settings);
    return log ? std::string("no error") : log.error().message;
  };
  SyntheticStream failing(6), resized(6);
  failing.fail_at = 3;
  resized.resize_at = 2;
  EXPECT_NE(message(failing, path_settings()).find("frame 3"), std::string::npos);
  EXPECT_NE(message(resized, path_settings()).find("frame 2"), std::string::npos);
  EXPECT_NE(message(SyntheticStream(0), path_settings()).find("no frame"), std::string::npos);
  for (const auto& break_it :
       {+[](RunSettings& s) { s.contact_rate = 0; }, +[](RunSettings& s) { s.contact_rate = NAN; },
        +[](RunSettings& s) { s.num_threads = -1; },
        +[](RunSettings& s) { s.surface.normals.radius = 1000; },
        +[](RunSettings& s) { s.objects.push_back({}); }}) {
    RunSettings settings = path_settings();
    break_it(settings);
    SyntheticStream stream(6);
    const auto log = run_path(tool, stream, pressing_pose, settings);
    ASSERT_FALSE(log);
    EXPECT_EQ(log.error().code, Errc::invalid_argument) << log.error().message;
  }
}

TEST(PathRun, NonFinitePoseMeasuresNothing) {
  const Tool tool = test::small_tool();
  SyntheticStream stream(2);
  const auto path = [](double time) {
    Pose pose = pressing_pose(time);
    if (time == 0.006) pose.translation.x = NAN;
    return pose;
  };
  const auto log = run_path(tool, stream, path, path_settings(500));
  ASSERT_TRUE(log) << log.error().message;
  // The tool goes on as it went, as with a device that leaves out a tick.
  const Vec3d before = log->ticks[2].step.X_WT.translation;
  const Vec3d there = log->ticks[3].step.X_WT.translation;
  EXPECT_LT(norm(there - pressing_pose(0.006).translation),
            0.1 * norm(pressing_pose(0.006).translation - before));
}

}  // namespace
}  // namespace palpate
