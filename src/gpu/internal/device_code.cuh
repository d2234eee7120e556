// The words that kernels are written in: CUDA's, or the emulator's where tests run them without a
// GPU. Kernel files (*.cu, *.cuh) include this instead of CUDA's headers.
#pragma once

#if defined(PALPATE_EMULATE_CUDA)
#include "src/gpu/internal/emulator.h"
#else
#include <cuda_runtime.h>
#endif
