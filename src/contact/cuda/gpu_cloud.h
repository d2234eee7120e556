// Copies of clouds in the memory of a GPU.
#pragma once

#include <cstdint>
#include <optional>

#include "palpate/cloud/point_cloud.h"
#include "src/contact/cuda/copy_slots.h"
#include "src/gpu/internal/runtime.h"

namespace palpate { inline namespace v0 {

/// Keeps copies of the last two clouds: the surfaces of a blend between two frames. Memory grows
/// with the first cloud of its size.
class GpuClouds {
 public:
  explicit GpuClouds(int gpu) : gpu_(gpu) {}

  /// Returns the cloud itself if it is on this GPU, else a copy, made in `stream` unless there is
  /// one with its stamp. A failure goes to the stream.
  PointCloudView on_gpu(const PointCloudView& cloud, gpu::Stream& stream);

 private:
  struct Copy {
    std::optional<gpu::Memory> memory;
    float* data = nullptr;
    std::size_t capacity = 0;  ///< points of each array
  };

  int gpu_;
  Copy copies_[CopySlots::kNum];
  CopySlots slots_;
};

}}  // namespace palpate::v0
