// Arrays for answers, in host memory or on a GPU.
#pragma once

#include <initializer_list>
#include <memory>
#include <type_traits>
#include <utility>
#include <vector>

#include "python/src/arrays.h"
#ifdef PALPATE_CUDA
#include "src/gpu/internal/runtime.h"
#endif

namespace palpate::python {

/// An array that Python owns, in host memory or on a GPU, of zeros. Bytes are of 0 and 1: bools on
/// a GPU, and see `bools`.
template <class T>
struct Made {
  T* at = nullptr;
  nb::object array;

  Made([[maybe_unused]] int gpu, std::initializer_list<std::size_t> shape) {
    std::size_t size = 1;
    for (const std::size_t each : shape) size *= each;
#ifdef PALPATE_CUDA
    if (gpu != kHostMemory) {
      auto memory = std::make_unique<gpu::Memory>(gpu);
      at = memory->take<T>(size);
      check(memory->status());
      const nb::capsule owner(memory.release(),
                              [](void* p) noexcept { delete static_cast<gpu::Memory*>(p); });
      const auto type = std::is_same_v<T, std::uint8_t> ? nb::dtype<bool>() : nb::dtype<T>();
      array = nb::cast(
          nb::ndarray<nb::array_api>(at, shape, owner, {}, type, nb::device::cuda::value, gpu));
      return;
    }
#endif
    std::vector<T> values(size);
    at = values.data();
    array = array_of(std::move(values), shape);
  }
  /// Returns an array of 0 and 1 as one of bools, where NumPy has it.
  nb::object bools(int gpu) const {
    return gpu == kHostMemory ? nb::object(array.attr("view")("bool")) : array;
  }
};

}  // namespace palpate::python
