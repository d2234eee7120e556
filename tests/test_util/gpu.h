// For tests of the CUDA backend: they run on GPU 0, or by the emulator in a build without CUDA.
#pragma once

#include <gtest/gtest.h>

#include "src/gpu/runtime.h"

/// First line of a test that needs a GPU.
#define PALPATE_GPU_OR_SKIP()                                             \
  if (const auto status = palpate::gpu::check_gpu(0); !status) {          \
    GTEST_SKIP() << "SKIPPED: no usable GPU: " << status.error().message; \
  }                                                                       \
  static_assert(true)
