// The adaptive filter of depth images on a GPU: what AdaptiveFilter does, by the same formulas and
// with the same bits. Large images go through four kernels of many blocks, small ones in a batch
// through one kernel that keeps an image in a block's shared memory.
#pragma once

#include <cstddef>
#include <cstdint>

#include "src/cloud/internal/frame_noise.h"
#include "src/cloud/surface/adaptive/scale_noise.h"
#include "src/gpu/internal/runtime.h"

namespace palpate { inline namespace v0 {

namespace one_lane {
struct FilterJob;
}

/// A level of an image: its cells in each of the arrays, with margins of cells without surface.
/// Strides and first cells are even, so that two cells of one wider cell can be written at once.
struct LevelCuda {
  int width = 0, height = 0;
  int stride = 0, first = 0;  ///< number of cell (0, 0)

  PALPATE_HOSTDEV int at(int u, int v) const { return first + v * stride + u; }
};

/// The levels of one image.
struct LevelsCuda {
  LevelCuda levels[kNumScales + 1];
  int num_cells = 0;  ///< of an array, with margins

  LevelsCuda(int width, int height, int margin);
  PALPATE_HOSTDEV const LevelCuda& operator[](int level) const { return levels[level]; }
};

/// Arrays of all images. A block of a kernel does a tile of an image: one cell of the widest level.
struct AdaptiveJob {
  LevelsCuda levels;
  std::ptrdiff_t cells_apart = 0;          ///< from one image's cells to those of the next
  float* mean = nullptr;                   ///< see ScaleLevel
  float* predicted = nullptr;              ///< not of the widest level, and so is energy
  float* energy = nullptr;                 ///< with that of all other levels
  std::uint32_t* counts = nullptr;         ///< as DetailCounts, kNumScales of each image
  std::uint32_t* seen = nullptr;           ///< of each of these: bits of the depths with details
  unsigned long long* num_done = nullptr;  ///< blocks of each image that have counted
  ScaleNoise* noise = nullptr;             ///< kNumScales of each image
  unsigned* free = nullptr;                ///< free pixels, as FilterJob::far
  /// Noise that is learned of each image, or null; of one by itself in page-locked memory.
  FrameNoise* frame_noise = nullptr;

  PALPATE_HOSTDEV int num_tiles() const {
    return levels[kNumScales].width * levels[kNumScales].height;
  }
};

/// Reads and smooths depth images of one size on a GPU. Nothing waits or allocates after
/// construction.
class AdaptiveCuda {
 public:
  /// Takes memory for the scales of some images; 0: of one that is not in a batch. Failures are
  /// left in `memory`.
  AdaptiveCuda(gpu::Memory& memory, int width, int height, int num_images);

  /// Submits the smoothing of the first images: from the raw frame of `job` to its depth, with the
  /// pixels that are too far. `noises`: of a batch, where the noise of each goes on the GPU, or
  /// null.
  void enqueue(gpu::Stream& stream, const one_lane::FilterJob& job, int num_images,
               FrameNoise* noises) const;
  /// Noise of the last image that is done by itself, in memory of the host; null of a batch.
  const FrameNoise* noise() const { return job_.frame_noise; }
  /// True if free pixels are infinite in what `enqueue` makes.
  bool marks_far() const { return !is_small_; }

 private:
  AdaptiveJob job_;
  bool is_small_ = false;  ///< an image fits a block's shared memory
};

}}  // namespace palpate::v0
