// Copies of depth fields in the memory of a GPU.
#pragma once

#include <cstdint>
#include <optional>

#include "palpate/field/depth_field.h"
#include "src/contact/cuda/copy_slots.h"
#include "src/gpu/internal/runtime.h"

namespace palpate { inline namespace v0 {

/// Keeps copies of the last two fields: the surfaces of a blend between two frames. Memory grows
/// with the first field of its size.
class GpuFields {
 public:
  explicit GpuFields(int gpu) : gpu_(gpu) {}

  /// Returns the field itself if it is on this GPU, else a copy, made in `stream` unless there is
  /// one with its stamp. A failure goes to the stream.
  DepthFieldView on_gpu(const DepthFieldView& field, gpu::Stream& stream) noexcept;

 private:
  struct Copy {
    std::optional<gpu::Memory> memory;
    float* planes = nullptr;
    Silhouette* silhouettes = nullptr;
    std::uint8_t* near_silhouette = nullptr;
    DepthTile* tiles = nullptr;
    std::uint32_t* filled_behind = nullptr;
    std::size_t num_pixels = 0, num_tiles = 0, num_words = 0;  ///< there is room for
  };

  bool grow(Copy& copy, std::size_t num_pixels, std::size_t num_tiles, std::size_t num_words,
            gpu::Stream& stream);

  int gpu_;
  Copy copies_[CopySlots::kNum];
  CopySlots slots_;
};

}}  // namespace palpate::v0
