#include "src/cloud/internal/depth_average_cuda.h"

#include <vector>

#include "src/cloud/average/depth_estimate.h"
#include "src/cloud/average/pixel_average.h"
#include "src/cloud/internal/raw_frame_cuda.h"
#include "src/core/internal/assert.h"
#include "src/gpu/internal/team.cuh"

namespace palpate { inline namespace v0 {

/// Arguments of the averaging kernel.
struct DepthAverageJob {
  DepthAverageOptions options;
  RawFrameView raw;
  PixelAverage* averages = nullptr;
  std::uint16_t* rings = nullptr;  // measurement by measurement, each of all pixels
  std::ptrdiff_t num_pixels = 0;
  float* depth = nullptr;
};

/// Arguments of the kernel of the Kalman filter.
struct DepthEstimateJob {
  EstimateModel model;
  RawFrameView raw;
  int width = 0, height = 0;
  int blocks_per_row = 0;
  float *mean = nullptr, *gain = nullptr;  // width * height
  BlockMemory* blocks = nullptr;
  float* depth = nullptr;
};

namespace {

constexpr int kThreads = 256;

__global__ void __launch_bounds__(kThreads)
    update_averages(const __grid_constant__ DepthAverageJob job) {
  const int i = gpu::grid_thread();
  if (i >= job.num_pixels) return;
  const double unit = *job.raw.unit;
  const std::uint16_t count = job.raw.pixels[i];
  if (job.options.kind == DepthAverage::none) {
    job.depth[i] = newest_depth(count, unit);
    return;
  }
  PixelAverage average = job.averages[i];
  // A moving average has rings; without, there is nothing to point into.
  const PixelRing ring{job.rings != nullptr ? job.rings + i : nullptr, job.num_pixels};
  job.depth[i] = update_average(average, ring, count, unit, job.options);
  job.averages[i] = average;
}

constexpr int kColumns = kEstimateBlock;
constexpr int kRows = kEstimateTile;  // of a thread, which does its column of a row of tiles
constexpr int kEstimateThreads = kColumns * kTilesPerBlock;
constexpr int kTiles = kTilesPerBlock * kTilesPerBlock;

// All threads read and write the memory of a block at once, word by word, so that the tests, which
// wait for each other, do not wait for memory.
constexpr int kMemoryWords = static_cast<int>(sizeof(BlockMemory) / sizeof(float));
static_assert(sizeof(BlockMemory) % sizeof(float) == 0);

struct EstimateShared {
  BlockMemory memory;
  TileSum columns[kEstimateThreads];
  BlockChange changes;
  SharedChange tiles[kTiles];
};

/// A block of threads does one block of the image.
__global__ void __launch_bounds__(kEstimateThreads)
    estimate_depth(const __grid_constant__ DepthEstimateJob job) {
  EstimateShared& shared = gpu::shared_memory<EstimateShared>();
  const int thread = static_cast<int>(threadIdx.x), block = static_cast<int>(blockIdx.x);
  const int block_row = block / job.blocks_per_row;
  const int row = thread / kColumns, column = thread - row * kColumns;
  const int u = (block - block_row * job.blocks_per_row) * kEstimateBlock + column;
  const int v0 = block_row * kEstimateBlock + row * kRows;
  const int num_rows = u >= job.width ? 0 : v0 + kRows <= job.height ? kRows : job.height - v0;
  const int my_tile = row * kTilesPerBlock + column / kEstimateTile;
  const std::ptrdiff_t first = static_cast<std::ptrdiff_t>(v0) * job.width + u;
  const double unit = *job.raw.unit;
  float* const remembered = reinterpret_cast<float*>(job.blocks + block);
  float* const words = reinterpret_cast<float*>(&shared.memory);
  BlockMemory& memory = shared.memory;

  for (int i = thread; i < kMemoryWords; i += kEstimateThreads) words[i] = remembered[i];
  float measured[kRows], mean[kRows], gain[kRows], own_gain[kRows];
#pragma unroll
  for (int v = 0; v < kRows; ++v) {
    const std::ptrdiff_t i = first + static_cast<std::ptrdiff_t>(v) * job.width;
    const bool inside = v < num_rows;
    measured[v] = inside ? depth_of(job.raw.pixels[i], unit) : 0.0f;
    mean[v] = inside ? job.mean[i] : 0.0f;
    gain[v] = inside ? job.gain[i] : kUnknownGain;
  }
  __syncthreads();

  const float scale = memory.noise_scale(my_tile);
  TileSum sum;
#pragma unroll
  for (int v = 0; v < kRows; ++v) {
    const one_lane::PixelDeviation d =
        one_lane::deviation_of(measured[v], mean[v], gain[v], scale, job.model);
    own_gain[v] = d.gain;
    sum.deviations.sum += d.sum;
    sum.deviations.num += d.num;
    sum.bounded.sum += d.bounded;
    sum.bounded.num += d.num_seen;
    sum.squares += d.squares;
    sum.num_known += d.num_known;
    sum.num_gone += d.num_gone;
  }
  shared.columns[thread] = sum;
  __syncthreads();

  if (thread < kTiles) {
    const TileSum* const columns = shared.columns + (thread / kTilesPerBlock) * kColumns +
                                   thread % kTilesPerBlock * kEstimateTile;
    TileSum tile;
    for (int i = 0; i < kEstimateTile; ++i) tile.add(columns[i]);
    shared.changes.take(thread, tile);
    shared.changes.test(0, thread, memory, job.model);
    memory.learn_noise(thread, tile, memory.noise_scale(thread));
  }
  __syncthreads();
  for (int level = 1; level < kEstimateLevels; ++level) {
    const int side = level_side(level);
    if (thread < side * side) {
      shared.changes.join(level, thread % side, thread / side);
      shared.changes.test(level, first_entry(level) + thread, memory, job.model);
    }
    __syncthreads();
  }
  if (thread < kEstimateLevels) shared.changes.learn_turns(thread, memory);
  if (thread < kTiles) {
    shared.tiles[thread] = shared.changes.of_tile(thread % kTilesPerBlock, thread / kTilesPerBlock);
  }
  __syncthreads();

  for (int i = thread; i < kMemoryWords; i += kEstimateThreads) remembered[i] = words[i];
  const SharedChange change = shared.tiles[my_tile];
#pragma unroll
  for (int v = 0; v < kRows; ++v) {
    if (v >= num_rows) continue;
    const std::ptrdiff_t i = first + static_cast<std::ptrdiff_t>(v) * job.width;
    const one_lane::PixelEstimate e =
        one_lane::estimate_of(measured[v], mean[v], gain[v], own_gain[v], change.follow,
                              change.gain, change.keep, job.model);
    job.mean[i] = e.mean;
    job.gain[i] = e.gain;
    job.depth[i] = e.depth > 0.0f ? e.depth : kNoAverage;
  }
}

}  // namespace

struct DepthAveragerCuda::Impl {
  gpu::Memory memory;
  int width, height;
  RawFrameCuda raw;
  DepthAverageJob job;
  DepthEstimateJob estimate;  // kalman
  int num_blocks = 0;

  Impl(int image_width, int image_height, const DepthAverageOptions& options, int gpu)
      : memory(gpu), width(image_width), height(image_height), raw(memory, width, height) {
    const std::size_t size = raw.pixels().size();
    job.options = options;
    job.raw = raw.view();
    job.num_pixels = static_cast<std::ptrdiff_t>(size);
    job.depth = memory.take<float>(size);
    switch (options.kind) {
      case DepthAverage::none: break;
      case DepthAverage::moving:
        job.rings = memory.take<std::uint16_t>(size * static_cast<std::size_t>(options.frames));
        [[fallthrough]];
      case DepthAverage::exponential: job.averages = memory.take<PixelAverage>(size); break;
      case DepthAverage::kalman:
        estimate.model = EstimateModel(options);
        estimate.raw = job.raw;
        estimate.width = width;
        estimate.height = height;
        estimate.blocks_per_row = (width + kEstimateBlock - 1) / kEstimateBlock;
        num_blocks = estimate.blocks_per_row * ((height + kEstimateBlock - 1) / kEstimateBlock);
        estimate.mean = memory.take<float>(size);
        estimate.gain = memory.copy_of(std::vector<float>(size, kUnknownGain));
        estimate.blocks = memory.take<BlockMemory>(static_cast<std::size_t>(num_blocks));
        estimate.depth = job.depth;
        break;
    }
  }
};

Result<DepthAveragerCuda> DepthAveragerCuda::create(int width, int height,
                                                    const DepthAverageOptions& options, int gpu) {
  const Status settings = check_average_settings(width, height, options);
  if (!settings) return settings.error();
  const Status device = gpu::check_gpu(gpu);
  if (!device) return device.error();
  auto impl = std::make_unique<Impl>(width, height, options, gpu);
  if (!impl->memory.status()) return impl->memory.status().error();
  return DepthAveragerCuda(std::move(impl));
}

DepthAveragerCuda::DepthAveragerCuda(std::unique_ptr<Impl> impl) : impl_(std::move(impl)) {}
DepthAveragerCuda::DepthAveragerCuda(DepthAveragerCuda&&) noexcept = default;
DepthAveragerCuda& DepthAveragerCuda::operator=(DepthAveragerCuda&&) noexcept = default;
DepthAveragerCuda::~DepthAveragerCuda() = default;

std::span<std::uint16_t> DepthAveragerCuda::input() { return impl_->raw.pixels(); }
void DepthAveragerCuda::set_unit(double unit) { impl_->raw.set_unit(unit); }

void DepthAveragerCuda::enqueue(gpu::Stream& stream) {
  Impl& d = *impl_;
  d.raw.enqueue_copy(stream, 0, d.height);
  if (d.job.options.kind == DepthAverage::kalman) {
    gpu::launch(stream,
                {.blocks = d.num_blocks,
                 .threads = kEstimateThreads,
                 .shared_bytes = sizeof(EstimateShared)},
                estimate_depth, d.estimate);
    return;
  }
  const int blocks = static_cast<int>((d.job.num_pixels + kThreads - 1) / kThreads);
  gpu::launch(stream, {.blocks = blocks, .threads = kThreads}, update_averages, d.job);
}

const float* DepthAveragerCuda::depth() const { return impl_->job.depth; }

}}  // namespace palpate::v0
