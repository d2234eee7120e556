// Averages and blends on a GPU against those of the CPU: the same bits.
#include <algorithm>
#include <string>

#include "src/cloud/internal/cloud_blend.h"
#include "src/cloud/internal/cloud_blend_cuda.h"
#include "src/cloud/internal/depth_average_cuda.h"
#include "src/cloud/internal/surface_cuda.h"
#include "tests/cloud/depth_scenes.h"
#include "tests/cloud/gpu_copies.h"
#include "tests/test_util/gpu.h"

namespace palpate {
namespace {

constexpr int kWidth = 41, kHeight = 30;

/// A noisy scene that jumps now and then, with lost pixels.
std::vector<DepthFrame> stream_of_frames(int num) {
  std::vector<DepthFrame> frames;
  for (int i = 0; i < num; ++i) {
    const double distance = i % 7 == 5 ? 1.6 : 1.2;
    frames.push_back(test::as_frame(
        test::cluttered_scene(kWidth, kHeight, 50, distance, static_cast<std::uint64_t>(i + 1))));
  }
  frames[2].pixels[50] = 65535;
  return frames;
}

TEST(DepthAveragerCuda, EqualsTheCpu) {
  PALPATE_GPU_OR_SKIP();
  const std::vector<DepthFrame> frames = stream_of_frames(20);
  ThreadPool pool(1);
  gpu::Stream stream(0, gpu::Priority::low);
  for (const DepthAverage kind :
       {DepthAverage::none, DepthAverage::moving, DepthAverage::exponential}) {
    for (const int num_frames : {1, 5, 64}) {
      for (const int keep : {0, 2}) {
        SCOPED_TRACE(std::to_string(static_cast<int>(kind)) + " " + std::to_string(num_frames));
        const DepthAverageOptions options{kind, num_frames, 0.3, 0.03, keep};
        DepthAverager cpu = std::move(DepthAverager::create(kWidth, kHeight, options)).value();
        DepthAveragerCuda cuda =
            std::move(DepthAveragerCuda::create(kWidth, kHeight, options, 0)).value();
        stream.begin_recording();
        cuda.enqueue(stream);
        const gpu::Graph graph = stream.end_recording();
        for (const DepthFrame& frame : frames) {
          std::ranges::copy(frame.pixels, cuda.input().begin());
          cuda.set_unit(frame.unit);
          stream.launch(graph);
          const std::span<const float> expected = cpu.update(frame, pool);
          ASSERT_NO_FATAL_FAILURE(test::expect_same_bits(
              test::copy_to_host(stream, cuda.depth(), expected.size()), expected.data(), "depth"));
        }
      }
    }
  }
}

// Blocks that the image cuts off, and surfaces that rest, move and vanish.
TEST(DepthAveragerCuda, EstimatesEqualTheCpu) {
  PALPATE_GPU_OR_SKIP();
  ThreadPool pool(1);
  gpu::Stream stream(0, gpu::Priority::low);
  for (const auto& [width, height] : {std::pair{kWidth, kHeight}, {150, 100}, {64, 128}}) {
    DepthAverageOptions options;
    options.kind = DepthAverage::kalman;
    options.noise_patch = 30;
    DepthAverager cpu = std::move(DepthAverager::create(width, height, options)).value();
    DepthAveragerCuda cuda =
        std::move(DepthAveragerCuda::create(width, height, options, 0)).value();
    stream.begin_recording();
    cuda.enqueue(stream);
    const gpu::Graph graph = stream.end_recording();
    for (int k = 0; k < 24; ++k) {
      const double distance = k < 12 ? 1.2 : 1.2 - 0.003 * k;
      DepthFrame frame = test::as_frame(test::cluttered_scene(
          width, height, 50, distance, static_cast<std::uint64_t>(k < 6 ? 1 : k)));
      if (k == 9) std::fill_n(frame.pixels.begin(), frame.pixels.size() / 2, std::uint16_t{0});
      std::ranges::copy(frame.pixels, cuda.input().begin());
      cuda.set_unit(frame.unit);
      stream.launch(graph);
      const std::span<const float> expected = cpu.update(frame, pool);
      ASSERT_NO_FATAL_FAILURE(test::expect_same_bits(
          test::copy_to_host(stream, cuda.depth(), expected.size()), expected.data(), "depth"));
    }
  }
}

TEST(DepthAveragerCuda, RefusesBadOptions) {
  PALPATE_GPU_OR_SKIP();
  EXPECT_FALSE(DepthAveragerCuda::create(kWidth, kHeight, {DepthAverage::moving, 65}, 0));
  EXPECT_FALSE(DepthAveragerCuda::create(7, kHeight, {}, 0));
}

// Averaged, estimated and blended: the chain of a stream that is predicted.
TEST(CloudBlendCuda, EqualsTheCpuBehindAveragedSurfaces) {
  PALPATE_GPU_OR_SKIP();
  const std::vector<DepthFrame> frames = stream_of_frames(3);
  const Intrinsics k = test::empty_scene(kWidth, kHeight, 50).intrinsics;
  DepthAverageOptions average;
  average.kind = DepthAverage::moving;
  ThreadPool pool(1);
  gpu::Stream stream(0, gpu::Priority::low);
  DepthAverager averager = std::move(DepthAverager::create(kWidth, kHeight, average)).value();
  DepthAveragerCuda averager_cuda =
      std::move(DepthAveragerCuda::create(kWidth, kHeight, average, 0)).value();
  std::vector<SurfaceEstimator> cpu;
  std::vector<SurfaceCuda> cuda;
  for (const DepthFrame& frame : frames) {
    cpu.push_back(std::move(SurfaceEstimator::create(kWidth, kHeight, k)).value());
    cpu.back().update(averager.update(frame, pool), pool);
    cuda.push_back(std::move(SurfaceCuda::create(kWidth, kHeight, k, {}, 0)).value());
    std::ranges::copy(frame.pixels, averager_cuda.input().begin());
    averager_cuda.set_unit(frame.unit);
    averager_cuda.enqueue(stream);
    cuda.back().enqueue_depth(stream, averager_cuda.depth());
    test::expect_same_cloud(stream, cuda.back().cloud(), cpu.back().cloud());
  }
  PointCloud expected(kWidth, kHeight, k);
  CloudBlendCuda blend = std::move(CloudBlendCuda::create(kWidth, kHeight, k, 0)).value();
  for (const std::size_t last : {1u, 2u}) {
    for (const double t : {0.0, 0.3, 1.0, 1.7}) {
      blend_clouds(cpu[last - 1].cloud(), cpu[last].cloud(), t, 0.03, pool, expected);
      blend.set_progress(t);
      blend.enqueue(stream, cuda[last - 1].cloud(), cuda[last].cloud(), 0.03);
      ASSERT_NO_FATAL_FAILURE(test::expect_same_cloud(stream, blend.cloud(), expected.view()));
    }
  }
}

}  // namespace
}  // namespace palpate
