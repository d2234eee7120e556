// Memory of a static camera for occluded space, on a GPU, with the same bits.
#pragma once

#include <utility>

#include "palpate/cloud/point_cloud.h"
#include "palpate/core/core.h"
#include "src/field/memory/memory_pixel.h"
#include "src/gpu/internal/runtime.h"

namespace palpate { inline namespace v0 {

/// Arguments of the kernel.
struct FieldMemoryJob {
  MemoryRule rule;
  const float* interval = nullptr;
  PixelMemory* pixels = nullptr;
  TangentPlane *behind = nullptr, *in_front = nullptr;
  int num_pixels = 0;
};

/// As FieldMemory. Nothing waits or allocates after `create`, and all work may be recorded.
class FieldMemoryCuda {
 public:
  /// Errors: too little memory on the GPU.
  static Result<FieldMemoryCuda> create(int width, int height, const MemoryOptions& options,
                                        int gpu);

  /// Sets the time between the next frame and the one before, s. Kept in page-locked memory: do not
  /// change it while submitted work has still to read it.
  void set_interval(double seconds) { *interval_ = static_cast<float>(seconds); }
  /// The cloud is on this GPU.
  void enqueue(const PointCloudView& cloud, gpu::Stream& stream);

  const TangentPlane* behind() const { return job_.behind; }
  const TangentPlane* in_front() const { return job_.in_front; }

 private:
  FieldMemoryCuda(gpu::Memory memory, const FieldMemoryJob& job, float* interval,
                  float* device_interval)
      : memory_(std::move(memory)),
        job_(job),
        interval_(interval),
        device_interval_(device_interval) {}

  gpu::Memory memory_;
  FieldMemoryJob job_;
  float *interval_, *device_interval_;
};

}}  // namespace palpate::v0
