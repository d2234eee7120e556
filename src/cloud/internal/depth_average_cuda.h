// Averages of raw depth over time on a GPU: what DepthAverager does, with the same bits.
#pragma once

#include <cstdint>
#include <memory>
#include <span>

#include "palpate/cloud/depth_source.h"

namespace palpate { inline namespace v0 {

namespace gpu {
class Stream;
}

/// Owns all buffers for one image size. Nothing waits or allocates after `create`, and all work may
/// be recorded in a gpu::Graph.
class DepthAveragerCuda {
 public:
  /// Errors: those of DepthAverager::create, no such GPU, not enough memory on it.
  static Result<DepthAveragerCuda> create(int width, int height, const DepthAverageOptions& options,
                                          int gpu);
  DepthAveragerCuda(DepthAveragerCuda&&) noexcept;
  DepthAveragerCuda& operator=(DepthAveragerCuda&&) noexcept;
  ~DepthAveragerCuda();

  /// Page-locked memory where the host puts the next raw frame and its unit (meters per count), as
  /// of SurfaceCuda.
  std::span<std::uint16_t> input();
  void set_unit(double unit);

  /// Takes the frame in `input` into the averages.
  void enqueue(gpu::Stream& stream);

  /// Meters on the GPU, NaN where there is no measurement; always the same array.
  const float* depth() const;

 private:
  struct Impl;
  explicit DepthAveragerCuda(std::unique_ptr<Impl> impl);
  std::unique_ptr<Impl> impl_;
};

}}  // namespace palpate::v0
