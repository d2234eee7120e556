// Many images at once on a GPU: the bits of the CPU's fields.
#include <gtest/gtest.h>

#include "src/cloud/internal/frame_noise.h"
#include "src/field/timeline/batch_frames.h"
#include "src/gpu/internal/runtime.h"
#include "src/gpu/internal/team.cuh"
#include "tests/field/device_views.h"
#include "tests/field/rough_images.h"
#include "tests/test_util/gpu.h"

namespace palpate {
namespace {

SlotSettings settings_of(const Camera& camera, const DepthFieldOptions& field = {}) {
  SlotSettings settings;
  settings.stream.width = camera.width;
  settings.stream.height = camera.height;
  settings.stream.intrinsics = camera.intrinsics;
  settings.stream.distortion = camera.distortion;
  settings.field = field;
  settings.time.mode = TimeMode::latest;
  return settings;
}

struct Expected {
  Sensor sensor;
  explicit Expected(const Camera& camera, const DepthFieldOptions& field = {})
      : sensor(std::move(Sensor::create(camera, Place::cpu(), {{}, field, 1, 1})).value()) {}

  void compare(const SurfaceBatch& got, const std::vector<DepthImageView>& images) {
    gpu::Stream stream(0, gpu::Priority::low);
    ASSERT_EQ(static_cast<std::size_t>(got.size()), images.size());
    for (std::size_t i = 0; i < images.size(); ++i) {
      SCOPED_TRACE(i);
      const SurfaceView surface = got[static_cast<int>(i)];
      EXPECT_EQ(surface.field.gpu, 0);
      const DepthFieldView want = sensor.update(images[i]).field;
      test::expect_same_field(surface.field, want, stream);
      FrameNoise noise;
      ASSERT_NE(got.noises(), nullptr) << "each learns its own";
      stream.copy(&noise, got.noises() + i, sizeof noise);
      ASSERT_TRUE(stream.wait());
      EXPECT_TRUE(noise == *want.noise);
    }
  }
};

std::vector<DepthImageView> views_of(const test::RoughImages& images, bool in_meters) {
  std::vector<DepthImageView> views;
  for (int i = 0; i < images.num; ++i) {
    views.push_back(in_meters ? images.image_in_meters(i) : images.image(i));
  }
  return views;
}

SurfaceBatch made(BatchFrames& frames, const DepthImageView& first, int num,
                  std::optional<CallerStream> stream = {}) {
  ThreadPool pool(1);
  auto surfaces = frames.update(first, num, stream, pool);
  EXPECT_TRUE(surfaces) << surfaces.error().message;
  return surfaces ? *surfaces : SurfaceBatch();
}

// Two images at a time, and all at once.
TEST(SensorBatchCuda, HasTheBitsOfTheCpu) {
  PALPATE_GPU_OR_SKIP();
  for (const auto& [width, height] : {std::pair{33, 20}, {40, 36}}) {
    test::RoughImages images(width, height, 5, 1);
    if (width == 40) images.camera.distortion = {-0.28, 0.09, 0.001, -0.002, -0.01};
    for (const UnknownSpace unknown :
         {UnknownSpace::free, UnknownSpace::solid, UnknownSpace::blocked}) {
      Expected want(images.camera, {.unknown = unknown});
      for (const int pixels : {2 * width * height, 1 << 20}) {
        auto frames =
            make_batch_frames_cuda(settings_of(images.camera, {.unknown = unknown}), 0, pixels)
                .value();
        for (const bool in_meters : {false, true}) {
          const auto views = views_of(images, in_meters);
          want.compare(made(*frames, views[0], 5), views);
          want.compare(made(*frames, views[1], 3), {views[1], views[2], views[3]});
        }
      }
    }
  }
}

// A level is done in several tiles, side by side and below each other.
TEST(SensorBatchCuda, HasTheBitsOfTheCpuInImagesOfManyTiles) {
  PALPATE_GPU_OR_SKIP();
  const test::RoughImages images(131, 67, 2, 7);
  const auto views = views_of(images, false);
  for (const DepthFieldOptions& options : {DepthFieldOptions{}, DepthFieldOptions{.fill_levels = 0},
                                           DepthFieldOptions{.unknown = UnknownSpace::solid},
                                           DepthFieldOptions{.unknown = UnknownSpace::blocked}}) {
    auto frames = make_batch_frames_cuda(settings_of(images.camera, options), 0).value();
    Expected want(images.camera, options);
    want.compare(made(*frames, views[0], 2), views);
  }
}

TEST(SensorBatchCuda, TakesImagesOnTheGpuAndCanBeRecorded) {
  PALPATE_GPU_OR_SKIP();
  const test::RoughImages images(33, 20, 3, 2), later(33, 20, 3, 3);
  auto frames = make_batch_frames_cuda(settings_of(images.camera), 0).value();
  gpu::Memory memory(0);
  gpu::Stream caller(0, gpu::Priority::low);
  std::uint16_t* const counts = memory.copy_of(images.counts);
  const DepthImageView first{33, 20, counts, 0.001, 0};
  ThreadPool pool(1);
  const CallerStream stream{caller.handle()};
  caller.begin_recording();
  EXPECT_FALSE(frames->update(first, 3, stream, pool)) << "no memory yet";
  caller.end_recording();
  ASSERT_TRUE(frames->reserve(3));
  caller.begin_recording();
  EXPECT_FALSE(frames->update(images.image(0), 3, stream, pool)) << "in host memory";
  caller.end_recording();
  caller.begin_recording();
  const SurfaceBatch surfaces = made(*frames, first, 3, stream);
  const gpu::Graph graph = caller.end_recording();
  Expected want(images.camera);
  for (const test::RoughImages* shown : {&images, &later, &images}) {
    caller.copy(counts, shown->counts.data(), shown->counts.size() * sizeof(std::uint16_t));
    caller.launch(graph);
    ASSERT_TRUE(caller.wait()) << caller.status().error().message;
    want.compare(surfaces, views_of(*shown, false));
  }
}

TEST(SensorBatchCuda, SaysHowManyImagesFit) {
  PALPATE_GPU_OR_SKIP();
  const test::RoughImages images(64, 64, 1, 4);
  auto frames = make_batch_frames_cuda(settings_of(images.camera), 0).value();
  const Status status = frames->reserve(10'000'000);
  ASSERT_FALSE(status);
  EXPECT_EQ(status.error().code, Errc::unavailable);
  const std::string& message = status.error().message;
  EXPECT_NE(message.find("10000000 images of 64 x 64 pixels take"), std::string::npos) << message;
  const auto at = message.find("free: give ");
  ASSERT_NE(at, std::string::npos) << message;
  const int fitting = std::stoi(message.substr(at + 11));
  EXPECT_GT(fitting, 1000);
  EXPECT_LT(fitting, 1'000'000);
  // It goes on.
  Expected want(images.camera);
  want.compare(made(*frames, images.image(0), 1), views_of(images, false));
}

}  // namespace
}  // namespace palpate
