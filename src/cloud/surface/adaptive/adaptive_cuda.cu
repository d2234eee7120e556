#include "src/cloud/surface/adaptive/adaptive_cuda.h"

#include <algorithm>

#include "src/cloud/surface/adaptive/adaptive_small.cuh"
#include "src/cloud/surface/adaptive/adaptive_tiles.cuh"

namespace palpate { inline namespace v0 {

LevelsCuda::LevelsCuda(int width, int height, int margin) {
  for (LevelCuda& level : levels) {
    level.width = width;
    level.height = height;
    level.stride = (width + 2 * margin + 1) / 2 * 2;
    level.first = num_cells + margin * level.stride + margin;
    num_cells += level.stride * (height + 2 * margin);
    width = (width + 1) / 2;
    height = (height + 1) / 2;
  }
}

AdaptiveCuda::AdaptiveCuda(gpu::Memory& memory, int width, int height, int num_images)
    : job_{LevelsCuda(width, height, one_lane::kMargin)} {
  const LevelsCuda small(width, height, one_lane::kReach);
  is_small_ = num_images > 0 && one_lane::fits_a_block(small, memory.gpu());
  if (is_small_) {
    job_.levels = small;
    return;
  }
  constexpr int kAligned = 32;
  job_.cells_apart = (job_.levels.num_cells + kAligned - 1) / kAligned * kAligned;
  const auto num = static_cast<std::size_t>(num_images > 0 ? num_images : 1);
  for (float** const array : {&job_.mean, &job_.predicted, &job_.energy}) {
    *array = memory.take<float>(num * static_cast<std::size_t>(job_.cells_apart));
  }
  job_.counts = memory.take<std::uint32_t>(num * std::size_t{one_lane::kNumCounts});
  job_.seen = memory.take<std::uint32_t>(num * kNumScales);
  job_.num_done = memory.take<unsigned long long>(num);
  job_.noise = memory.take<ScaleNoise>(num * kNumScales);
  const std::size_t words =
      (static_cast<std::size_t>(job_.levels[0].width) + one_lane::kTileWidth - 1) /
      std::size_t{one_lane::kTileWidth} * static_cast<std::size_t>(job_.levels[0].height);
  job_.free = memory.take<unsigned>(num * words);
  if (num_images == 0) job_.frame_noise = memory.take_pinned<FrameNoise>(1);
}

void AdaptiveCuda::enqueue(gpu::Stream& stream, const one_lane::FilterJob& filter, int num_images,
                           FrameNoise* noises) const {
  if (is_small_) {
    gpu::launch(stream,
                {.blocks = num_images,
                 .threads = one_lane::kSmallThreads,
                 .shared_bytes = one_lane::small_bytes(job_.levels)},
                one_lane::smooth_small_images, filter, job_.levels, noises);
    return;
  }
  AdaptiveJob job = job_;
  if (noises != nullptr) job.frame_noise = noises;
  const auto launch = [&](std::size_t shared_bytes, auto* kernel, const auto&... arguments) {
    gpu::launch(stream,
                {.blocks = num_images * job_.num_tiles(),
                 .threads = one_lane::kAdaptiveThreads,
                 .shared_bytes = shared_bytes},
                kernel, arguments...);
  };
  launch(sizeof(one_lane::BeginShared), one_lane::begin_scales, filter, job);
  gpu::launch(
      stream,
      {.blocks = num_images * (job_.num_tiles() + filter.tiling.num_tiles),
       .threads = one_lane::kPredictThreads,
       .shared_bytes = std::max(sizeof(one_lane::PredictShared), sizeof(one_lane::FarShared))},
      one_lane::predict_scales, filter, job, num_images);
  launch(sizeof(one_lane::EnergyShared), one_lane::find_energies, job);
  launch(sizeof(one_lane::SmoothShared), one_lane::smooth_scales, filter, job);
}

}}  // namespace palpate::v0
