#include <memory>
#include <utility>

#include <gtest/gtest.h>

#include "src/field/timeline/frame_slots.h"
#include "tests/backends/backend_features.h"
#include "tests/cloud/depth_scenes.h"
#include "tests/field/device_views.h"

namespace palpate::test {
namespace {

constexpr int kWidth = 45, kHeight = 38;
constexpr double kPeriod = 0.04;

SlotSettings default_settings() {
  SlotSettings settings;
  settings.stream.width = kWidth;
  settings.stream.height = kHeight;
  settings.stream.intrinsics = empty_scene(kWidth, kHeight, 55).intrinsics;
  settings.stream.rate = 1 / kPeriod;
  settings.surface.depth_change.min_step = 0.01;
  settings.time.mode = TimeMode::latest;
  settings.wants_depth_change = true;
  return settings;
}

/// A cluttered scene that comes nearer.
DepthFrame frame(int number) {
  return as_frame(cluttered_scene(kWidth, kHeight, 55, 0.9 - 0.004 * number, 5), 0.0005);
}

SurfaceTimeline timeline(Result<std::unique_ptr<FrameSlots>> slots, const SlotSettings& settings) {
  EXPECT_TRUE(slots) << slots.error().message;
  return std::move(FrameSlots::make_timeline(*std::move(slots), settings)).value();
}

void expect_same(const SurfaceView& got, const SurfaceView& want, gpu::Stream& stream) {
  expect_same_cloud(got.cloud, want.cloud, stream);
  if (want.field.num_levels > 0) expect_same_field(got.field, want.field, stream);
  if (want.in_front.num_levels > 0) expect_same_field(got.in_front, want.in_front, stream);
}

/// Points, normals, depth-change vectors and field of all frames.
void compare(const SlotSettings& settings) {
  gpu::Stream stream(0, gpu::Priority::low);
  ThreadPool pool(1);
  SurfaceTimeline cpu = timeline(make_frame_slots_cpu(settings), settings);
  SurfaceTimeline cuda = timeline(make_frame_slots_cuda(settings, 0), settings);
  const TimeOptions& options = settings.time;
  const bool looks_back = options.mode != TimeMode::latest ||
                          options.average.kind != DepthAverage::none ||
                          options.memory.kind != DepthMemory::off;
  const int num_frames = looks_back ? 4 : 1;
  for (int number = 0; number < num_frames; ++number) {
    const double time = number * kPeriod;
    const SurfaceStats want = cpu.push(frame(number), time, pool);
    const SurfaceStats got = cuda.push(frame(number), time, pool);
    ASSERT_TRUE(cuda.status()) << cuda.status().error().message;
    EXPECT_GT(want.num_points, 300);
    EXPECT_EQ(got.num_valid, want.num_valid);
    EXPECT_EQ(got.num_points, want.num_points);
    const SurfaceBlend a = cuda.at(time + kPeriod / 4), b = cpu.at(time + kPeriod / 4);
    EXPECT_EQ(a.progress, b.progress);
    expect_same(a.from, b.from, stream);
    expect_same(a.to, b.to, stream);
  }
}

/// The same bits, with the default settings changed.
Feature with(std::string name, const std::function<void(SlotSettings&)>& change) {
  return {std::move(name), 0, [change](double) {
            SlotSettings settings = default_settings();
            change(settings);
            compare(settings);
          }};
}

FeatureGroup surfaces() {
  return {
      "Surfaces",
      {
          with("adaptive filter", [](SlotSettings&) {}),
          with("bilateral filter, its window and widths",
               [](SlotSettings& s) {
                 s.surface.filter.smoothing = Smoothing::bilateral;
                 s.surface.filter.radius = 7;
                 s.surface.filter.sigma_space = 3;
               }),
          with("no filter", [](SlotSettings& s) { s.surface.filter.enabled = false; }),
          with("normals: plane fit along the ray", [](SlotSettings&) {}),
          with("normals: principal components",
               [](SlotSettings& s) { s.surface.normals.fit = PlaneFit::principal; }),
          with("normals: window, depth gate, minimum neighbors",
               [](SlotSettings& s) {
                 s.surface.normals.radius = 7;
                 s.surface.normals.max_depth_change = 0.01;
                 s.surface.normals.min_neighbors = 9;
               }),
          with("normals: anchoring", [](SlotSettings& s) { s.surface.normals.anchoring = true; }),
          with("normals: weighting", [](SlotSettings& s) { s.surface.normals.weighting = true; }),
          with("normals: normalization",
               [](SlotSettings& s) { s.surface.normals.normalization = true; }),
          with("depth change at edges",
               [](SlotSettings& s) { s.surface.depth_change.min_step = 0.03; }),
          with("no depth change", [](SlotSettings& s) { s.surface.depth_change.enabled = false; }),
          with("minimum and maximum depth",
               [](SlotSettings& s) {
                 s.surface.min_depth = 0.5;
                 s.surface.max_depth = 0.95;
               }),
      }};
}

FeatureGroup time() {
  return {"Time",
          {
              with("latest frame", [](SlotSettings&) {}),
              with("interpolation between frames",
                   [](SlotSettings& s) { s.time.mode = TimeMode::interpolate; }),
              with("prediction of the next frame",
                   [](SlotSettings& s) { s.time.mode = TimeMode::predict; }),
              with("moving average of depth",
                   [](SlotSettings& s) {
                     s.time.average = {.kind = DepthAverage::moving, .frames = 3};
                   }),
              with("exponential average of depth",
                   [](SlotSettings& s) { s.time.average.kind = DepthAverage::exponential; }),
              with("estimate of depth over time (kalman)",
                   [](SlotSettings& s) { s.time.average.kind = DepthAverage::kalman; }),
              with("averages and prediction together",
                   [](SlotSettings& s) {
                     s.time.mode = TimeMode::predict;
                     s.time.average.kind = DepthAverage::exponential;
                   }),
              with("memory of what is hidden",
                   [](SlotSettings& s) {
                     // The last frame comes before the others.
                     s.time.memory = {.kind = DepthMemory::on, .step = 0.01};
                   }),
          }};
}

FeatureGroup field() {
  return {"Depth field",
          {
              with("unknown space free", [](SlotSettings&) {}),
              with("unknown space solid",
                   [](SlotSettings& s) { s.field->unknown = UnknownSpace::solid; }),
              with("holes filled far", [](SlotSettings& s) { s.field->fill_levels = 5; }),
              with("no hole filled", [](SlotSettings& s) { s.field->fill_levels = 0; }),
              with("thickness", [](SlotSettings& s) { s.field->unseen = UnseenSpace::free; }),
              with("no field made", [](SlotSettings& s) { s.field = std::nullopt; }),
          }};
}

}  // namespace

std::vector<FeatureGroup> sensing_features() { return {surfaces(), time(), field()}; }

}  // namespace palpate::test
