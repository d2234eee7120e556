#include "palpate/field/sensor.h"

#include <cmath>
#include <cstring>

#include <gtest/gtest.h>

#include "src/field/internal/field_point.h"
#include "tests/test_util/allocation_counter.h"

namespace palpate {
namespace {

constexpr int kWidth = 48, kHeight = 40;
constexpr double kPeriod = 0.04, kUnit = 1e-5;
constexpr double kSpeed = -0.05;  // m/s

DepthStreamInfo stream_info() {
  DepthStreamInfo info;
  info.width = kWidth;
  info.height = kHeight;
  info.intrinsics = {60, 60, 23.5, 19.5};
  info.rate = 1 / kPeriod;
  info.unit = kUnit;
  return info;
}

/// A wall that stays in the range of 16 bits of kUnit.
double wall_depth(double time) { return 0.5 + kSpeed * time; }

DepthFrame wall_frame(double depth) {
  DepthFrame frame;
  frame.width = kWidth;
  frame.height = kHeight;
  frame.unit = kUnit;
  frame.pixels.assign(kWidth * kHeight, static_cast<std::uint16_t>(std::lround(depth / kUnit)));
  return frame;
}

TimeOptions options_of(TimeMode mode) {
  TimeOptions options;
  options.mode = mode;
  return options;
}

SurfaceTimeline make_timeline(const TimeOptions& options, int num_spare = 0) {
  return std::move(
             SurfaceTimeline::create(stream_info(), {.time = options, .num_spare = num_spare}))
      .value();
}

/// Depth of the wall in the middle of the image, as points and as field say.
void expect_wall(const SurfaceView& surfaces, double depth) {
  const std::size_t middle = 20 * kWidth + 23;
  EXPECT_NEAR(surfaces.cloud.z[middle], depth, kUnit);
  EXPECT_NEAR(surfaces.cloud.nz[middle], -1, 1e-6);
  EXPECT_NEAR(sample_field(surfaces.field, {0.0, 0.0, depth}, 0.005).phi, 0, 1.5 * kUnit);
}

class Wall {
 public:
  explicit Wall(const TimeOptions& options, int num_spare = 0)
      : timeline(make_timeline(options, num_spare)) {}

  void show(double time) { timeline.push(wall_frame(wall_depth(time)), time, pool); }

  ThreadPool pool{1};
  SurfaceTimeline timeline;
};

TEST(SurfaceTimeline, InterpolatesFromTheLastFrameToTheNewestOne) {
  Wall wall(options_of(TimeMode::interpolate));
  for (int k = 0; k < 5; ++k) wall.show(k * kPeriod);
  const double start = 4 * kPeriod;
  for (const double share : {0.0, 0.3, 0.75}) {
    const SurfaceBlend moment = wall.timeline.at(start + share * kPeriod);
    EXPECT_NEAR(moment.progress, share, 1e-9);
    expect_wall(moment.from, wall_depth(3 * kPeriod));
    expect_wall(moment.to, wall_depth(4 * kPeriod));
  }
}

TEST(SurfaceTimeline, LatestHasNothingToBlend) {
  Wall wall(options_of(TimeMode::latest));
  for (int k = 0; k < 3; ++k) {
    wall.show(k * kPeriod);
    const SurfaceBlend moment = wall.timeline.at(k * kPeriod);
    EXPECT_EQ(moment.progress, 1);
    expect_wall(moment.to, wall_depth(k * kPeriod));
  }
}

// A wall at constant speed is predicted where it truly will be, so what is felt in between is the
// wall as it is now.
TEST(SurfaceTimeline, PredictsTheWallAtConstantSpeed) {
  Wall wall(options_of(TimeMode::predict));
  for (int k = 0; k < 5; ++k) wall.show(k * kPeriod);
  const SurfaceBlend moment = wall.timeline.at(4.5 * kPeriod);
  expect_wall(moment.from, wall_depth(4 * kPeriod));
  expect_wall(moment.to, wall_depth(5 * kPeriod));
}

TEST(SurfaceTimeline, PredictsOnePeriodAheadAfterDroppedFrames) {
  Wall wall(options_of(TimeMode::predict));
  double time = 0;
  for (int k = 0; k < 5; ++k) wall.show(time = k * kPeriod);
  wall.show(time += 3 * kPeriod);
  const double period = wall.timeline.period();
  expect_wall(wall.timeline.at(time).to, wall_depth(time + period));
}

// A pixel that moves too far to show one surface stays where it was seen last.
TEST(SurfaceTimeline, DoesNotPredictJumps) {
  Wall wall(options_of(TimeMode::predict));
  wall.timeline.push(wall_frame(0.6), 0, wall.pool);
  wall.timeline.push(wall_frame(0.4), kPeriod, wall.pool);
  expect_wall(wall.timeline.at(kPeriod).to, 0.4);
  wall.timeline.push(wall_frame(0), 2 * kPeriod, wall.pool);
  wall.timeline.push(wall_frame(0.4), 3 * kPeriod, wall.pool);
  expect_wall(wall.timeline.at(3 * kPeriod).to, 0.4);
}

// At each new frame the next blend starts at the surface that was felt last.
TEST(SurfaceTimeline, MomentsJoinWhenFramesArrive) {
  for (const TimeMode mode : {TimeMode::interpolate, TimeMode::predict}) {
    Wall wall(options_of(mode));
    wall.timeline.push(wall_frame(0.5), 0, wall.pool);
    for (int k = 1; k < 6; ++k) {
      const SurfaceBlend before = wall.timeline.at(k * kPeriod);
      EXPECT_NEAR(before.progress, 1, 1e-9);
      const double felt = before.to.cloud.z[500];
      wall.timeline.push(wall_frame(0.5 + 0.005 * std::sin(k)), k * kPeriod, wall.pool);
      const SurfaceBlend after = wall.timeline.at(k * kPeriod);
      EXPECT_EQ(after.progress, 0);
      EXPECT_EQ(after.from.cloud.z[500], static_cast<float>(felt)) << k;
    }
  }
}

TEST(SurfaceTimeline, WaitsForLateFramesAndNeverLooksBack) {
  Wall wall(options_of(TimeMode::interpolate));
  EXPECT_EQ(wall.timeline.at(0).progress, 1);  // nothing yet: nothing to feel
  EXPECT_EQ(wall.timeline.at(0).to.field.num_levels, 0);
  wall.show(0);
  EXPECT_EQ(wall.timeline.at(0.001).progress, 1);  // the first frame stands alone
  wall.show(kPeriod);
  EXPECT_EQ(wall.timeline.at(kPeriod + 10).progress, 1);
  EXPECT_EQ(wall.timeline.at(kPeriod - 0.01).progress, 0);
}

TEST(SurfaceTimeline, LearnsTheFramePeriod) {
  Wall wall(options_of(TimeMode::interpolate));
  EXPECT_DOUBLE_EQ(wall.timeline.period(), kPeriod);
  double time = 0;
  for (int k = 0; k < 60; ++k) wall.show(time += 0.1);  // the stream is slower than it said
  EXPECT_NEAR(wall.timeline.period(), 0.1, 1e-3);
  wall.show(time += 5);  // one long break
  EXPECT_LT(wall.timeline.period(), 0.12);
}

TEST(SurfaceTimeline, AveragesFirst) {
  TimeOptions options = options_of(TimeMode::latest);
  options.average = {DepthAverage::moving, 4};
  Wall wall(options);
  for (int k = 0; k < 6; ++k) wall.show(k * kPeriod);
  expect_wall(wall.timeline.at(5 * kPeriod).to, wall_depth(3.5 * kPeriod));
}

TEST(SurfaceTimeline, AveragesBeginWithTheFirstFrameInEveryPixel) {
  for (const DepthAverage kind : {DepthAverage::moving, DepthAverage::exponential}) {
    TimeOptions options = options_of(TimeMode::latest);
    options.average.kind = kind;
    Wall wall(options);
    wall.show(0);
    const PointCloudView cloud = wall.timeline.at(0).to.cloud;
    for (std::size_t i = 0; i < cloud.size(); ++i) {
      ASSERT_NEAR(cloud.z[i], wall_depth(0), kUnit) << "pixel " << i;
    }
  }
}

TEST(SurfaceTimeline, SameBitsForAnyNumberOfThreadsAndNoAllocation) {
  TimeOptions options = options_of(TimeMode::predict);
  options.average.kind = DepthAverage::exponential;
  std::vector<float> first;
  for (const int num_threads : {1, 2, 5}) {
    ThreadPool pool(num_threads);
    SurfaceTimeline timeline = make_timeline(options);
    std::vector<DepthFrame> frames;
    for (int k = 0; k < 5; ++k) frames.push_back(wall_frame(0.5 + 0.004 * std::sin(3 * k)));
    const test::AllocationCounter counter;
    for (int k = 0; k < 5; ++k) {
      timeline.push(frames[static_cast<std::size_t>(k)], k * kPeriod, pool);
      timeline.at(k * kPeriod + 0.01);
    }
    EXPECT_EQ(counter.count(), 0u);
    const float* z = timeline.at(1).to.cloud.z;
    if (first.empty()) first.assign(z, z + kWidth * kHeight);
    EXPECT_EQ(std::memcmp(first.data(), z, first.size() * sizeof(float)), 0);
  }
}

// Views stay valid for a thread while another one pushes; and nothing else differs.
TEST(SurfaceTimeline, SpareSurfacesKeepTheViewsOverAPush) {
  for (const TimeMode mode : {TimeMode::latest, TimeMode::interpolate, TimeMode::predict}) {
    Wall wall(options_of(mode), 1), bare(options_of(mode));
    wall.show(0);
    bare.show(0);
    for (int k = 1; k < 8; ++k) {
      const SurfaceBlend before = wall.timeline.at(k * kPeriod);
      const float from = before.from.cloud.z[500], to = before.to.cloud.z[500];
      wall.show(k * kPeriod);
      bare.show(k * kPeriod);
      EXPECT_EQ(before.from.cloud.z[500], from);
      EXPECT_EQ(before.to.cloud.z[500], to);
      const SurfaceBlend after = wall.timeline.at(k * kPeriod),
                         same = bare.timeline.at(k * kPeriod);
      EXPECT_EQ(after.from.cloud.z[500], same.from.cloud.z[500]);
      EXPECT_EQ(after.to.cloud.z[500], same.to.cloud.z[500]);
      EXPECT_EQ(after.progress, same.progress);
    }
  }
}

TEST(SurfaceTimeline, RefusesBadOptions) {
  const auto make = [](const DepthStreamInfo& info, const TimeOptions& options) {
    return SurfaceTimeline::create(info, {.time = options});
  };
  TimeOptions options;
  options.max_jump = NAN;
  EXPECT_FALSE(make(stream_info(), options));
  options = {};
  options.average = {DepthAverage::moving, 1000};
  EXPECT_FALSE(make(stream_info(), options));
  DepthStreamInfo info = stream_info();
  info.rate = 0;
  EXPECT_FALSE(make(info, {}));
  options = {};
  options.first_period = 0.04;
  EXPECT_TRUE(make(info, options));  // then the stream need not say
  options.first_period = -1;
  EXPECT_FALSE(make(stream_info(), options));
  info = stream_info();
  info.width = 3;
  EXPECT_FALSE(make(info, {}));
}

}  // namespace
}  // namespace palpate
