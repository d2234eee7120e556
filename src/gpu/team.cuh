// How the threads of a kernel work together: shared memory, barriers, sums in a fixed order.
#pragma once

#include <cstdint>

#include "src/gpu/device_code.cuh"

namespace palpate::gpu {

constexpr int kWarpSize = 32;
constexpr unsigned kWholeWarp = 0xffffffffu;

__device__ inline int lane_id() { return static_cast<int>(threadIdx.x) % kWarpSize; }
__device__ inline int warp_id() { return static_cast<int>(threadIdx.x) / kWarpSize; }
__device__ inline int warps_per_block() { return static_cast<int>(blockDim.x) / kWarpSize; }
/// Number of this thread in the grid, and how many there are: for (i = grid_thread(); i < num;
/// i += grid_threads()).
__device__ inline int grid_thread() {
  return static_cast<int>(blockIdx.x * blockDim.x + threadIdx.x);
}
__device__ inline int grid_threads() { return static_cast<int>(gridDim.x * blockDim.x); }

/// The block's shared memory, LaunchShape::shared_bytes large, seen as a T. (No `__shared__`
/// variables: the emulator runs many blocks in one thread.)
template <class T>
__device__ inline T& shared_memory() {
#if defined(PALPATE_EMULATE_CUDA)
  return *static_cast<T*>(emulator::shared_memory());
#else
  extern __shared__ __align__(16) unsigned char palpate_shared_bytes[];
  return *reinterpret_cast<T*>(palpate_shared_bytes);
#endif
}

/// A value that other threads or the host change meanwhile.
template <class T>
__device__ inline T read_now(const T* value) {
  return *static_cast<const volatile T*>(value);
}

/// Every thread of a cooperative grid arrives here before any goes on; what was written before is
/// visible after. `count` starts at 0 and belongs to kernels with one number of blocks.
__device__ inline void grid_barrier(unsigned long long* count) {
  __syncthreads();
  if (threadIdx.x == 0) {
    __threadfence();
    const unsigned long long ticket = atomicAdd(count, 1ull), blocks = gridDim.x;
    const unsigned long long all = (ticket / blocks + 1) * blocks;
    while (read_now(count) < all) {
#if defined(PALPATE_EMULATE_CUDA)
      emulator::yield();
#endif
    }
    __threadfence();
  }
  __syncthreads();
}

/// True in all threads of the block that calls this last; it sees what the others wrote before.
/// `count` starts at 0 and belongs to kernels with one number of blocks. `shared` is for this
/// alone.
__device__ inline bool is_last_block(unsigned long long* count, int* shared) {
  __syncthreads();
  if (threadIdx.x == 0) {
    __threadfence();
    const unsigned long long ticket = atomicAdd(count, 1ull);
    *shared = (ticket + 1) % gridDim.x == 0;
    __threadfence();
  }
  __syncthreads();
  return *shared != 0;
}

/// The sum over the warp, in all lanes, always in the same order.
template <class T>
__device__ inline T warp_sum(T value) {
  for (int step = kWarpSize / 2; step > 0; step /= 2) {
    value += __shfl_xor_sync(kWholeWarp, value, step);
  }
  return value;
}

/// Sums over the block of each of `num` values, left in values[] of thread 0 alone; always in the
/// same order. `shared` holds num values of each warp; all threads call.
template <class T>
__device__ inline void block_sum(T* values, int num, T* shared) {
  for (int i = 0; i < num; ++i) values[i] = warp_sum(values[i]);
  if (lane_id() == 0) {
    for (int i = 0; i < num; ++i) shared[warp_id() * num + i] = values[i];
  }
  __syncthreads();
  if (threadIdx.x == 0) {
    for (int i = 0; i < num; ++i) {
      for (int warp = 1; warp < warps_per_block(); ++warp) values[i] += shared[warp * num + i];
    }
  }
  __syncthreads();
}

}  // namespace palpate::gpu
