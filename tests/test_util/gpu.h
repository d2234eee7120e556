// For tests of the CUDA backend: they run on GPU 0, or by the emulator in a build without CUDA.
#pragma once

#include <cstdint>
#include <cstdlib>

#include <gtest/gtest.h>

#include "src/gpu/internal/runtime.h"
#if defined(PALPATE_EMULATE_CUDA)
#include "src/gpu/internal/emulator.h"
#endif

/// First line of a test that needs a GPU.
#define PALPATE_GPU_OR_SKIP()                                             \
  if (const auto status = palpate::gpu::check_gpu(0); !status) {          \
    GTEST_SKIP() << "SKIPPED: no usable GPU: " << status.error().message; \
  }                                                                       \
  static_assert(true)

namespace palpate::test {

#if defined(PALPATE_EMULATE_CUDA)
inline constexpr bool kIsEmulated = true;
#else
inline constexpr bool kIsEmulated = false;
#endif
/// Tests measure fewer poses of smaller tools: the emulator and compute-sanitizer are slow.
inline const bool kIsShort = kIsEmulated || std::getenv("PALPATE_SHORT_TESTS") != nullptr;

/// Runs `body` in several orders of threads where the emulator can choose one, else twice.
template <class Body>
void in_all_orders(const Body& body) {
#if defined(PALPATE_EMULATE_CUDA)
  for (const std::uint32_t seed : {1u, 2u, 3u}) {
    emulator::set_order(seed);
    body();
  }
  emulator::set_order(0);
#else
  body();
#endif
  body();
}

}  // namespace palpate::test
