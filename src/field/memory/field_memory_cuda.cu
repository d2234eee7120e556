#include "src/field/memory/field_memory_cuda.h"

#include "src/core/internal/assert.h"
#include "src/gpu/internal/team.cuh"

namespace palpate { inline namespace v0 {
namespace {

constexpr int kThreads = 256;

__global__ void __launch_bounds__(kThreads)
    remember_planes(const __grid_constant__ FieldMemoryJob job,
                    const __grid_constant__ PointCloudView cloud) {
  const int i = gpu::grid_thread();
  if (i >= job.num_pixels) return;
  const TangentPlane now = plane_of(cloud, i);
  const float z = seen_depth(cloud, i);
  const MemoryPlanes planes = remember(now, z, job.rule, *job.interval, job.pixels[i]);
  job.behind[i] = planes.behind;
  job.in_front[i] = planes.in_front;
}

}  // namespace

Result<FieldMemoryCuda> FieldMemoryCuda::create(int width, int height, const MemoryOptions& options,
                                                int gpu) {
  const auto num = static_cast<std::size_t>(width) * static_cast<std::size_t>(height);
  gpu::Memory memory(gpu);
  FieldMemoryJob job;
  job.rule = memory_rule(options);
  job.pixels = memory.take<PixelMemory>(num);  // zeroes: nothing has been seen
  job.behind = memory.take<TangentPlane>(num);
  job.in_front = memory.take<TangentPlane>(num);
  job.num_pixels = static_cast<int>(num);
  auto* const interval = memory.take_pinned<float>(1);
  auto* const device_interval = memory.take<float>(1);
  if (!memory.status()) return memory.status().error();
  job.interval = device_interval;
  return FieldMemoryCuda(std::move(memory), job, interval, device_interval);
}

void FieldMemoryCuda::enqueue(const PointCloudView& cloud, gpu::Stream& stream) {
  PALPATE_ASSERT(cloud.gpu == memory_.gpu() && static_cast<int>(cloud.size()) == job_.num_pixels);
  stream.copy(device_interval_, interval_, sizeof(float));
  const int blocks = (job_.num_pixels + kThreads - 1) / kThreads;
  gpu::launch(stream, {.blocks = blocks, .threads = kThreads}, remember_planes, job_, cloud);
}

}}  // namespace palpate::v0
