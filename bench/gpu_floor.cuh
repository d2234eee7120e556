// Lower bound of the time of a GPU query: launches, barriers and synchronization without work.
#pragma once

#include <cstdint>

#include "src/gpu/internal/runtime.h"
#include "src/gpu/internal/team.cuh"

namespace palpate::bench {

/// Raises the flag that the host waits for.
__global__ void raise_flag(std::uint64_t* flag, std::uint64_t number) {
  if (gpu::grid_thread() == 0) {
    *flag = number;
    __threadfence_system();
  }
}

/// The same after `num_barriers` barriers of the whole grid.
__global__ void raise_flag_after(std::uint64_t* flag, std::uint64_t number,
                                 unsigned long long* barrier, int num_barriers) {
  for (int i = 0; i < num_barriers; ++i) gpu::grid_barrier(barrier);
  if (gpu::grid_thread() == 0) {
    *flag = number;
    __threadfence_system();
  }
}

/// The same by the last block.
__global__ void raise_flag_last(std::uint64_t* flag, std::uint64_t number,
                                unsigned long long* count) {
  if (!gpu::is_last_block(count, &gpu::shared_memory<int>()) || threadIdx.x != 0) return;
  *flag = number;
  __threadfence_system();
}

__global__ void do_nothing() {}

}  // namespace palpate::bench
