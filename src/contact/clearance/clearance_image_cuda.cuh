// The image of a camera for searches on a GPU: made there from the depth field. Included by the
// file that searches.
#pragma once

#include <utility>

#include "src/contact/clearance/clearance_image.h"
#include "src/contact/cuda/gpu_field.h"
#include "src/gpu/internal/device_code.cuh"

namespace palpate { inline namespace v0 { namespace {

__global__ void take_blocks(const __grid_constant__ ClearanceImage image,
                            const __grid_constant__ DepthFieldLevel pixels, float* nearest) {
  const std::int32_t wide = image.blocks_wide[0], num = wide * image.blocks_high[0];
  for (std::int32_t i = gpu::grid_thread(); i < num; i += gpu::grid_threads()) {
    take_depths(image, pixels, i % wide, i / wide, nearest);
  }
}

__global__ void merge_blocks(const __grid_constant__ ClearanceImage image, int level,
                             float* nearest, float* farthest) {
  const std::int32_t wide = 4 * image.blocks_wide[level], num = wide * 4 * image.blocks_high[level];
  for (std::int32_t i = gpu::grid_thread(); i < num; i += gpu::grid_threads()) {
    merge_depths(image, level, i % wide, i / wide, nearest, farthest);
  }
}

__global__ void copy_squares(const __grid_constant__ ClearanceImage image, float* squares) {
  const std::int32_t wide = image.windows.wide[0], num = wide * image.windows.high[0];
  for (std::int32_t i = gpu::grid_thread(); i < num; i += gpu::grid_threads()) {
    squares[i] = image.nearest[1][image.place(1, i % wide, i / wide)];
  }
}

__global__ void merge_windows(const __grid_constant__ WindowMerge part, const float* from,
                              float* merged) {
  const std::int32_t wide = part.merged_wide(), num = wide * part.merged_high();
  for (std::int32_t i = gpu::grid_thread(); i < num; i += gpu::grid_threads()) {
    merged[i] = part.least(from, i % wide, i / wide);
  }
}

constexpr int kThreads = 128;
inline int blocks_for(std::size_t num, int each) {
  const auto per_block = static_cast<std::size_t>(each);
  return static_cast<int>((num + per_block - 1) / per_block);
}

/// One image of a scene.
class ImageOnGpu {
 public:
  explicit ImageOnGpu(int gpu) : memory_(gpu), copies_(gpu) {}

  bool is_of(const DepthFieldView& view) const {
    return view.stamp != 0 && stamp_ == view.stamp && thickness_ == view.thickness;
  }
  /// Failures go to the stream.
  void update(const DepthFieldView& view, bool is_blocked, gpu::Stream& stream) {
    const DepthFieldView field = copies_.on_gpu(view, stream);
    const ClearanceImage old = std::exchange(image_, image_of(view, is_blocked));
    if (old.width != image_.width || old.height != image_.height) {
      stream.wait();
      memory_ = gpu::Memory(stream.gpu());
      for (int level = 0; level < ClearanceImage::kLevels; ++level) {
        nearest_[level] = memory_.take<float>(image_.num_places(level));
        farthest_[level] = level > 0 ? memory_.take<float>(image_.num_places(level)) : nearest_[0];
      }
      windows_ = memory_.take<float>(image_.windows.num_places());
      squares_ = memory_.take<float>(2 * num_squares());
      if (!memory_.status()) {
        image_ = {};
        return stream.fail(memory_.status().error());
      }
    }
    for (int level = 0; level < ClearanceImage::kLevels; ++level) {
      image_.nearest[level] = nearest_[level];
      image_.farthest[level] = farthest_[level];
    }
    if (!stream.status()) return;
    gpu::launch(stream, {.blocks = blocks_for(image_.num_places(0) / 16, kThreads)}, take_blocks,
                image_, field.levels[0], nearest_[0]);
    for (int level = 1; level < ClearanceImage::kLevels; ++level) {
      gpu::launch(stream, {.blocks = blocks_for(image_.num_places(level), kThreads)}, merge_blocks,
                  image_, level, nearest_[level], farthest_[level]);
    }
    stamp_ = view.stamp;
    thickness_ = view.thickness;
    if (is_blocked) return;  // searched with others only
    image_.windows.nearest = windows_;
    make_windows(
        image_, squares_, windows_,
        [&](float* squares) {
          gpu::launch(stream, {.blocks = blocks_for(num_squares(), kThreads)}, copy_squares, image_,
                      squares);
        },
        [&](const WindowMerge& part, const float* from, float* merged) {
          const auto num = static_cast<std::size_t>(part.merged_wide() * part.merged_high());
          gpu::launch(stream, {.blocks = blocks_for(num, kThreads)}, merge_windows, part, from,
                      merged);
        });
  }

  const ClearanceImage& image() const { return image_; }

 private:
  std::size_t num_squares() const {
    return static_cast<std::size_t>(image_.windows.wide[0] * image_.windows.high[0]);
  }

  gpu::Memory memory_;
  GpuFields copies_;
  ClearanceImage image_;
  std::uint64_t stamp_ = 0;
  float thickness_ = 0;
  float *nearest_[ClearanceImage::kLevels] = {}, *farthest_[ClearanceImage::kLevels] = {};
  float *windows_ = nullptr, *squares_ = nullptr;
};

}}}  // namespace palpate::v0
