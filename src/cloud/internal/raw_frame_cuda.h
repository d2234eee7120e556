// A raw depth frame on its way to a GPU.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>

#include "src/gpu/internal/runtime.h"

namespace palpate { inline namespace v0 {

/// A raw frame in device memory. The unit lies in front of the first row and comes with it.
struct RawFrameView {
  const double* unit = nullptr;
  const std::uint16_t* pixels = nullptr;
};

/// The same in page-locked memory and on the GPU.
class RawFrameCuda {
 public:
  /// Failures are left in `memory`, which owns the arrays.
  RawFrameCuda(gpu::Memory& memory, int width, int height)
      : width_(static_cast<std::size_t>(width)),
        num_pixels_(width_ * static_cast<std::size_t>(height)),
        host_(memory.take_pinned<std::byte>(kPixels + 2 * num_pixels_)),
        device_(memory.take<std::byte>(kPixels + 2 * num_pixels_)) {}

  std::span<std::uint16_t> pixels() {
    return {reinterpret_cast<std::uint16_t*>(host_ + kPixels), num_pixels_};
  }
  void set_unit(double unit) { *reinterpret_cast<double*>(host_) = unit; }

  /// Submits a copy of the rows [first, end), with the unit in front of the first one.
  void enqueue_copy(gpu::Stream& stream, int first, int end) {
    if (first == end) return;
    const std::size_t begin = first == 0 ? 0 : row_start(first);
    stream.copy(device_ + begin, host_ + begin, row_start(end) - begin);
  }
  /// Submits copies of the unit that was set, and of pixels that are on this GPU.
  void enqueue_copy_of(gpu::Stream& stream, const std::uint16_t* pixels) {
    enqueue_unit(stream);
    stream.copy(device_ + kPixels, pixels, 2 * num_pixels_);
  }
  /// Submits a copy of the unit that was set.
  void enqueue_unit(gpu::Stream& stream) { stream.copy(device_, host_, kPixels); }
  RawFrameView view() const {
    return {reinterpret_cast<const double*>(device_),
            reinterpret_cast<const std::uint16_t*>(device_ + kPixels)};
  }

 private:
  static constexpr std::size_t kPixels = 16;  // their first byte
  std::size_t row_start(int row) const {
    return kPixels + 2 * width_ * static_cast<std::size_t>(row);
  }

  std::size_t width_, num_pixels_;
  std::byte* host_;
  std::byte* device_;
};

}}  // namespace palpate::v0
