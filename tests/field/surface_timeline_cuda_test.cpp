// Surfaces made on a GPU are those of the CPU, in all modes.
#include <algorithm>
#include <cmath>
#include <string>
#include <vector>

#include <gtest/gtest.h>

#include "src/cloud/internal/frame_noise.h"
#include "src/field/timeline/frame_slots.h"
#include "tests/field/device_views.h"
#include "tests/test_util/gpu.h"
#include "tests/test_util/random.h"

namespace palpate {
namespace {

constexpr int kWidth = 49, kHeight = 42;

SlotSettings settings_with(TimeMode mode, DepthAverage average) {
  SlotSettings settings;
  settings.stream.width = kWidth;
  settings.stream.height = kHeight;
  settings.stream.intrinsics = {60, 60, 23.5, 19.5};
  settings.stream.rate = 25;
  settings.field = DepthFieldOptions{};
  settings.time.mode = mode;
  settings.time.average.kind = average;
  settings.time.average.frames = 3;
  settings.wants_depth_change = true;
  return settings;
}

/// A bumpy wall that comes nearer, in front of it a ball that moves sideways; with holes, and a
/// corner that is too far.
DepthFrame frame(int k) {
  DepthFrame result;
  result.width = kWidth;
  result.height = kHeight;
  result.unit = 0.0002;
  test::Random random(static_cast<std::uint64_t>(k));
  for (int v = 0; v < kHeight; ++v) {
    for (int u = 0; u < kWidth; ++u) {
      const bool is_ball = std::hypot(u - 15 - 3 * k, v - 20) < 8;
      const double z = (is_ball ? 0.4 : 0.6) - 0.003 * k + 0.004 * std::sin(0.3 * u + k) +
                       0.001 * random.normal();
      const bool is_hole = random.uniform() < 0.03;
      if (u + v < 20 + 2 * k) {
        result.pixels.push_back(kFarCount);
        continue;
      }
      result.pixels.push_back(is_hole ? 0
                                      : static_cast<std::uint16_t>(std::lround(z / result.unit)));
    }
  }
  return result;
}

SurfaceTimeline timeline_on_gpu(const SlotSettings& settings) {
  auto slots = make_frame_slots_cuda(settings, 0);
  EXPECT_TRUE(slots) << slots.error().message;
  return std::move(FrameSlots::make_timeline(*std::move(slots), settings)).value();
}

SurfaceTimeline timeline_on_cpu(const SlotSettings& settings) {
  return std::move(
             FrameSlots::make_timeline(std::move(make_frame_slots_cpu(settings)).value(), settings))
      .value();
}

void expect_same(const SurfaceView& got, const SurfaceView& want, gpu::Stream& stream) {
  EXPECT_EQ(got.cloud.gpu, 0);
  EXPECT_EQ(want.cloud.gpu, kHostMemory);
  test::expect_same_cloud(got.cloud, want.cloud, stream);
  EXPECT_EQ(got.field.gpu, want.field.num_levels > 0 ? 0 : kHostMemory);
  for (auto field : {&SurfaceView::field, &SurfaceView::seen_free, &SurfaceView::in_front,
                     &SurfaceView::remembered}) {
    ASSERT_EQ((got.*field).num_levels, (want.*field).num_levels);
    if ((want.*field).num_levels == 0) continue;
    test::expect_same_field(got.*field, want.*field, stream);
    ASSERT_NE((got.*field).noise, nullptr);
    EXPECT_TRUE(std::ranges::equal((got.*field).noise->base, (want.*field).noise->base));
    EXPECT_TRUE(std::ranges::equal((got.*field).noise->growth, (want.*field).noise->growth));
    EXPECT_EQ((got.*field).noise->is_whole, (want.*field).noise->is_whole);
  }
}

void compare(const SlotSettings& settings) {
  gpu::Stream stream(0, gpu::Priority::low);
  ThreadPool pool(1);
  SurfaceTimeline on_gpu = timeline_on_gpu(settings), on_cpu = timeline_on_cpu(settings);
  std::vector<std::uint64_t> stamps;
  for (int k = 0; k < 5; ++k) {
    SCOPED_TRACE("frame " + std::to_string(k));
    const double time = 0.04 * (k == 4 ? 6 : k);  // a frame is dropped
    const SurfaceStats got = on_gpu.push(frame(k), time, pool);
    const SurfaceStats want = on_cpu.push(frame(k), time, pool);
    ASSERT_TRUE(on_gpu.status()) << on_gpu.status().error().message;
    EXPECT_EQ(got.num_valid, want.num_valid);
    EXPECT_EQ(got.num_points, want.num_points);
    const SurfaceBlend a = on_gpu.at(time + 0.01), b = on_cpu.at(time + 0.01);
    EXPECT_EQ(a.progress, b.progress);
    expect_same(a.from, b.from, stream);
    expect_same(a.to, b.to, stream);
    for (const SurfaceView& surfaces : {a.to, b.to}) {
      for (const std::uint64_t stamp : {surfaces.cloud.stamp, surfaces.field.stamp}) {
        EXPECT_EQ(std::count(stamps.begin(), stamps.end(), stamp), 0);
        if (stamp != 0) stamps.push_back(stamp);
      }
    }
    const PointCloud seen = on_gpu.newest_cloud(pool), seen_by_cpu = on_cpu.newest_cloud(pool);
    ASSERT_EQ(seen.size(), seen_by_cpu.size());
    for (std::size_t i = 0; i < seen.size(); ++i) {
      ASSERT_TRUE(seen.point(i) == seen_by_cpu.point(i) || std::isnan(seen.point(i).z));
    }
  }
}

TEST(SurfaceTimelineCuda, HasTheBitsOfTheCpuInAllModes) {
  PALPATE_GPU_OR_SKIP();
  for (const TimeMode mode : {TimeMode::latest, TimeMode::interpolate, TimeMode::predict}) {
    for (const DepthAverage average :
         {DepthAverage::none, DepthAverage::moving, DepthAverage::exponential}) {
      SCOPED_TRACE("mode " + std::to_string(static_cast<int>(mode)) + ", average " +
                   std::to_string(static_cast<int>(average)));
      compare(settings_with(mode, average));
    }
  }
}

TEST(SurfaceTimelineCuda, RemembersWhatTheCpuRemembers) {
  PALPATE_GPU_OR_SKIP();
  for (const TimeMode mode : {TimeMode::latest, TimeMode::interpolate}) {
    for (const bool is_one_of_several : {false, true}) {
      SlotSettings settings = settings_with(mode, DepthAverage::none);
      settings.time.memory = {.kind = DepthMemory::on, .horizon = 0.05};
      settings.field->one_of_several = is_one_of_several;
      compare(settings);
    }
  }
}

TEST(SurfaceTimelineCuda, TakesCountsAndMetersFromHostAndGpu) {
  PALPATE_GPU_OR_SKIP();
  const SlotSettings settings = settings_with(TimeMode::predict, DepthAverage::none);
  ThreadPool pool(1);
  for (const bool as_meters : {false, true}) {
    for (const bool on_gpu : {false, true}) {
      SCOPED_TRACE(std::string(as_meters ? "meters" : "counts") + (on_gpu ? " on the GPU" : ""));
      gpu::Stream stream(0, gpu::Priority::low);
      gpu::Memory memory(0);
      SurfaceTimeline got = timeline_on_gpu(settings), want = timeline_on_cpu(settings);
      for (int k = 0; k < 3; ++k) {
        const DepthFrame counts = frame(k);
        std::vector<float> meters;
        for (const std::uint16_t count : counts.pixels) {
          meters.push_back(static_cast<float>(count * counts.unit));
        }
        DepthImageView image = counts;
        if (as_meters) image = {kWidth, kHeight, meters.data()};
        DepthImageView shown = image;
        if (on_gpu) {
          shown.gpu = 0;
          if (as_meters) shown.meters = memory.copy_of(meters);
          if (!as_meters) shown.counts = memory.copy_of(counts.pixels);
        }
        got.push(shown, 0.04 * k, pool);
        want.push(image, 0.04 * k, pool);
        ASSERT_TRUE(got.status()) << got.status().error().message;
        expect_same(got.at(0.04 * k).to, want.at(0.04 * k).to, stream);
      }
    }
  }
}

TEST(SurfaceTimelineCuda, SameBitsInAnyOrder) {
  PALPATE_GPU_OR_SKIP();
  test::in_all_orders([] { compare(settings_with(TimeMode::predict, DepthAverage::exponential)); });
}

TEST(SurfaceTimelineCuda, MakesNoFieldUnlessAsked) {
  PALPATE_GPU_OR_SKIP();
  SlotSettings settings = settings_with(TimeMode::interpolate, DepthAverage::none);
  settings.field = std::nullopt;
  compare(settings);
}

TEST(SurfaceTimelineCuda, ShowsNothingBeforeTheFirstFrame) {
  PALPATE_GPU_OR_SKIP();
  ThreadPool pool(1);
  SurfaceTimeline timeline = timeline_on_gpu(settings_with(TimeMode::predict, DepthAverage::none));
  EXPECT_EQ(timeline.at(0).progress, 1);
  EXPECT_EQ(timeline.at(0).to.cloud.size(), 0u);
  EXPECT_EQ(timeline.at(0).to.field.num_levels, 0);
  EXPECT_TRUE(std::isnan(timeline.newest_cloud(pool).point(100).z));
}

TEST(SurfaceTimelineCuda, RefusesBadOptions) {
  PALPATE_GPU_OR_SKIP();
  SlotSettings settings = settings_with(TimeMode::latest, DepthAverage::moving);
  settings.time.average.frames = 1000;
  EXPECT_FALSE(make_frame_slots_cuda(settings, 0));
  settings = settings_with(TimeMode::latest, DepthAverage::none);
  settings.stream.width = 3;
  EXPECT_FALSE(make_frame_slots_cuda(settings, 0));
  settings = settings_with(TimeMode::latest, DepthAverage::none);
  settings.field->fill_levels = 9;
  EXPECT_FALSE(make_frame_slots_cuda(settings, 0));
}

#if !defined(PALPATE_CUDA)
TEST(SurfaceTimelineCuda, IsAClearErrorInABuildWithoutIt) {
  const SlotSettings settings = settings_with(TimeMode::latest, DepthAverage::none);
  const auto timeline = SurfaceTimeline::create(settings.stream, {}, Place::cuda());
  ASSERT_FALSE(timeline);
  EXPECT_EQ(timeline.error().code, Errc::unavailable);
  EXPECT_NE(timeline.error().message.find("no CUDA backend"), std::string::npos);
}
#endif

}  // namespace
}  // namespace palpate
