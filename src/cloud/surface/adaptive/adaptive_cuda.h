// The adaptive filter of depth images on a GPU: what AdaptiveFilter does, by the same formulas and
// with the same bits.
#pragma once

#include <cstddef>

#include "src/cloud/surface/adaptive/scale_noise.h"
#include "src/gpu/internal/runtime.h"

namespace palpate { inline namespace v0 {

/// One level of the first image: arrays on the GPU, with margins of cells without surface.
struct LevelCuda {
  int width = 0, height = 0;
  std::ptrdiff_t stride = 0;
  float* mean = nullptr;       ///< cell (0, 0); see ScaleLevel
  float* predicted = nullptr;  ///< not of the widest level, and so is energy
  float* energy = nullptr;

  PALPATE_HOSTDEV std::ptrdiff_t at(int u, int v) const { return v * stride + u; }
};

/// Arrays of all images. A block of a kernel does a tile of an image: one cell of the widest level.
struct AdaptiveJob {
  LevelCuda levels[kNumScales + 1];
  std::ptrdiff_t cells_apart = 0;  ///< from one image's cells to those of the next
  float* depth = nullptr;          ///< m, not a number where there is none; smoothed in place
  std::ptrdiff_t depth_apart = 0;  ///< from one image to the next
  DetailCounts* counts = nullptr;  ///< kNumScales of each image
  ScaleNoise* noise = nullptr;     ///< the same
};

/// Smooths depth images of one size on a GPU. Nothing waits or allocates after construction.
class AdaptiveCuda {
 public:
  /// Takes memory for the scales of some images. Failures are left in `memory`. `depth`: width *
  /// height values of each image, `depth_apart` values from one to the next.
  AdaptiveCuda(gpu::Memory& memory, int width, int height, int num_images, float* depth,
               std::ptrdiff_t depth_apart);

  /// Submits the smoothing of the first images.
  void enqueue(gpu::Stream& stream, int num_images) const;

 private:
  AdaptiveJob job_;
};

}}  // namespace palpate::v0
