// Surfaces of a run between depth frames.
#include <algorithm>
#include <cmath>

#include <gtest/gtest.h>

#include "src/run/internal/pipeline.h"
#include "src/session/internal/run_messages.h"
#include "tests/session/function_stream.h"
#include "tests/session/path_run.h"
#include "tests/session/synthetic_stream.h"
#include "tests/test_util/allocation_counter.h"

namespace palpate {
namespace {

using test::SyntheticStream;

constexpr TimeMode kModes[] = {TimeMode::latest, TimeMode::interpolate, TimeMode::predict};
/// Held still in the wall that comes nearer by 2 mm a frame.
Pose held(double) { return {{0.002, 0.005, 0.49}, axis_angle({1, 2, 3}, 0.2)}; }

RunSettings settings_with(TimeMode mode) {
  RunSettings settings = test::path_settings();
  settings.time.mode = mode;
  settings.contact.method = MethodKind::field;
  return settings;
}

Result<test::PathLog> run(const Tool& tool, const RunSettings& settings) {
  SyntheticStream stream(8, 32);  // time stamps without rounding
  return test::run_path(tool, stream, held, settings);
}

TEST(RunBetweenFrames, OnlyTheLatestFrameAloneMakesSteps) {
  const Tool tool = test::small_tool();
  for (const TimeMode mode : kModes) {
    const auto log = run(tool, settings_with(mode));
    ASSERT_TRUE(log) << log.error().message;
    std::vector<double> steps;
    double largest_arrival = 0;
    for (std::size_t k = 1; k < log->ticks.size(); ++k) {
      const TickRecord &last = log->ticks[k - 1], &now = log->ticks[k];
      if (now.frame_number < 3) continue;  // a prediction needs two frames
      const double step = norm(now.penetration.measure_W.force - last.penetration.measure_W.force);
      steps.push_back(step);
      if (now.frame_number != last.frame_number) largest_arrival = std::max(largest_arrival, step);
    }
    std::nth_element(steps.begin(), steps.begin() + std::ssize(steps) / 2, steps.end());
    const double median = steps[steps.size() / 2];
    if (mode == TimeMode::latest) {
      EXPECT_EQ(median, 0);
      EXPECT_GT(largest_arrival, 0);
    } else {
      EXPECT_GT(median, 0);
      EXPECT_LT(largest_arrival, 3 * median);
    }
  }
}

TEST(RunBetweenFrames, InterpolationEndsWhereTheLatestFrameIs) {
  const Tool tool = test::small_tool();
  const auto latest = run(tool, settings_with(TimeMode::latest));
  const auto interpolated = run(tool, settings_with(TimeMode::interpolate));
  ASSERT_TRUE(latest && interpolated);
  // At tick 125 frame 4 arrives: the way to frame 3 has just been gone.
  const auto volume = [](const test::PathLog& log, std::size_t tick) {
    return log.ticks[tick].penetration.volume;
  };
  EXPECT_NEAR(volume(*interpolated, 125), volume(*latest, 124), 1e-9 * volume(*latest, 124));
  EXPECT_GT(volume(*latest, 125), 1.02 * volume(*latest, 124));
}

TEST(RunBetweenFrames, SameNumbersForAnyNumberOfThreads) {
  const Tool tool = test::small_tool();
  for (const TimeMode mode : kModes) {
    for (const DepthAverage average : {DepthAverage::none, DepthAverage::moving,
                                       DepthAverage::exponential, DepthAverage::kalman}) {
      std::vector<TickRecord> first;
      for (const int num_threads : {1, 3}) {
        RunSettings settings = settings_with(mode);
        settings.time.average.kind = average;
        settings.num_threads = num_threads;
        const auto log = run(tool, settings);
        ASSERT_TRUE(log) << log.error().message;
        if (first.empty()) first = log->ticks;
        ASSERT_EQ(log->ticks.size(), first.size());
        for (std::size_t k = 0; k < first.size(); ++k) {
          ASSERT_EQ(difference(log->ticks[k], first[k]), "");
        }
      }
    }
  }
}

// A hand, 0.4 m away, passes over a table behind a tool that is between both.
TEST(RunBetweenFrames, WithAMemoryNothingIsFeltBehindAHandThatPasses) {
  const Tool tool = test::small_tool();
  const auto scene = [](double time, int u, int v) {
    const bool is_hand = std::abs(u - 600 * (time - 0.2)) < 40 && std::abs(v - 90) < 30;
    return is_hand ? 0.4 : 0.6;
  };
  const auto between = [](double) { return Pose{{0, 0, 0.54}, {}}; };
  for (const auto& [kind, num_threads] :
       {std::pair{DepthMemory::off, 1}, {DepthMemory::on, 1}, {DepthMemory::on, 3}}) {
    test::FunctionStream stream(scene, test::every(0.04, 25));
    RunSettings settings = settings_with(TimeMode::interpolate);
    settings.time.memory.kind = kind;
    settings.num_threads = num_threads;
    const auto log = test::run_path(tool, stream, between, settings);
    ASSERT_TRUE(log) << log.error().message;
    const double most = log->ticks[log->deepest_tick].penetration.volume;
    if (kind == DepthMemory::off) {
      EXPECT_GT(most, 0.9 * tool.sphere_mass().volume);
      continue;
    }
    EXPECT_EQ(most, 0);
    EXPECT_GT(log->ticks.size(), 900u);
  }
}

TEST(RunBetweenFrames, ViewsOfAllCamerasAndWhatTheyRememberAreNoMoreThanAQueryTakes) {
  SyntheticStream stream(2);
  RunSettings settings = settings_with(TimeMode::interpolate);
  settings.time.memory.kind = DepthMemory::on;
  const Tool tool = test::small_tool();
  std::vector<DepthStreamInfo> streams(2, stream.info());
  EXPECT_TRUE(Pipeline::create(tool, streams, DeviceInfo{}, settings));
  // A static camera remembers by its pixels, a moving one by frames from where it was.
  settings.time.memory.frames = 15;
  streams[1].is_moving = true;
  auto made = Pipeline::create(tool, streams, DeviceInfo{}, settings);
  ASSERT_TRUE(made);
  DepthFrame frame;
  ASSERT_TRUE(stream.next(frame).value());
  for (int k = 0; k < 20; ++k) {
    frame.X_WC = {};
    made->push(frame, k / 30.0, 0);
    frame.X_WC = {{3.0 * k, 0, 0}, {}};  // where it has seen nothing yet
    made->push(frame, k / 30.0, 1);
    made->measure({{0, 0, 0.5}, {}}, k / 30.0);
    EXPECT_EQ(made->cameras().size(), 2u + static_cast<std::size_t>(std::min(k + 1, 14)));
    EXPECT_FALSE(made->contact().penetration.status.is_unmeasured());
  }
}

TEST(RunBetweenFrames, TicksAndFramesDoNotAllocate) {
  const Tool tool = test::small_tool();
  SyntheticStream stream(4);
  DepthFrame frames[4];
  for (DepthFrame& frame : frames) ASSERT_TRUE(stream.next(frame).value());
  for (const DepthAverage average : {DepthAverage::moving, DepthAverage::kalman}) {
    RunSettings settings = settings_with(TimeMode::predict);
    settings.time.average.kind = average;
    settings.num_threads = 1;
    auto pipeline = Pipeline::create(tool, stream.info(), DeviceInfo{}, settings);
    ASSERT_TRUE(pipeline) << pipeline.error().message;
    const test::AllocationCounter counter;
    for (int k = 0; k < 4; ++k) {
      pipeline->push(frames[k], k / 30.0);
      pipeline->measure(held(0), k / 30.0 + 0.01);
    }
    EXPECT_EQ(counter.count(), 0u);
  }
}

TEST(RunBetweenFrames, RefusesBadAverages) {
  RunSettings settings = settings_with(TimeMode::latest);
  settings.time.average = {DepthAverage::moving, 0};
  EXPECT_FALSE(run(test::small_tool(), settings));
}

}  // namespace
}  // namespace palpate
