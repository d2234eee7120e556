#include "src/cloud/depth_average_cuda.h"

#include "src/cloud/depth_average_options.h"
#include "src/cloud/pixel_average.h"
#include "src/cloud/raw_frame_cuda.h"
#include "src/gpu/team.cuh"

namespace palpate {

/// What the kernel reads and writes.
struct DepthAverageJob {
  DepthAverageOptions options;
  RawFrameView raw;
  int first_pixel = 0, end_pixel = 0;
  PixelMemory* memories = nullptr;
  std::uint16_t* rings = nullptr;  // measurement by measurement, each of all pixels
  std::ptrdiff_t num_pixels = 0;
  float* depth = nullptr;
};

namespace {

constexpr int kThreads = 256;

__global__ void __launch_bounds__(kThreads)
    update_averages(const __grid_constant__ DepthAverageJob job) {
  const int i = job.first_pixel + gpu::grid_thread();
  if (i >= job.end_pixel) return;
  const double unit = *job.raw.unit;
  const std::uint16_t count = job.raw.pixels[i];
  if (job.options.kind == DepthAverage::none) {
    job.depth[i] = newest_depth(count, unit);
    return;
  }
  PixelMemory memory = job.memories[i];
  job.depth[i] =
      update_average(memory, PixelRing{job.rings + i, job.num_pixels}, count, unit, job.options);
  job.memories[i] = memory;
}

}  // namespace

struct DepthAveragerCuda::Impl {
  gpu::Memory memory;
  int width, height;
  RawFrameCuda raw;
  DepthAverageJob job;

  Impl(int image_width, int image_height, const DepthAverageOptions& options, int gpu)
      : memory(gpu), width(image_width), height(image_height), raw(memory, width, height) {
    const std::size_t size = raw.pixels().size();
    job.options = options;
    job.raw = raw.view();
    job.num_pixels = static_cast<std::ptrdiff_t>(size);
    job.depth = memory.take<float>(size);
    if (options.kind != DepthAverage::none) job.memories = memory.take<PixelMemory>(size);
    if (options.kind == DepthAverage::moving) {
      job.rings = memory.take<std::uint16_t>(size * static_cast<std::size_t>(options.frames));
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

void DepthAveragerCuda::enqueue(gpu::Stream& stream) { enqueue(stream, {0, impl_->height}); }

void DepthAveragerCuda::enqueue(gpu::Stream& stream, ImageRows rows) {
  Impl& d = *impl_;
  if (rows.begin >= rows.end) return;
  d.raw.enqueue_copy(stream, rows);
  DepthAverageJob job = d.job;
  job.first_pixel = rows.begin * d.width;
  job.end_pixel = rows.end * d.width;
  const int blocks = (job.end_pixel - job.first_pixel + kThreads - 1) / kThreads;
  gpu::launch(stream, {.blocks = blocks, .threads = kThreads}, update_averages, job);
}

const float* DepthAveragerCuda::depth() const { return impl_->job.depth; }

}  // namespace palpate
