// Cooperation of the threads of a kernel: shared memory, barriers, sums in a fixed order.
#pragma once

#include <cstdint>

#include "src/gpu/internal/device_code.cuh"

namespace palpate { inline namespace v0 { namespace gpu {

inline constexpr int kWarpSize = 32;
inline constexpr unsigned kWholeWarp = 0xffffffffu;

__device__ inline int lane_id() { return static_cast<int>(threadIdx.x % unsigned{kWarpSize}); }
__device__ inline int warp_id() { return static_cast<int>(threadIdx.x / unsigned{kWarpSize}); }
__device__ inline int warps_per_block() {
  return static_cast<int>(blockDim.x / unsigned{kWarpSize});
}
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

/// Shared memory at an address that stays in a register: a compiler would compute it anew for each
/// access. The whole warp calls.
template <class T>
__device__ inline T& kept(T& in_shared_memory) {
#if defined(PALPATE_EMULATE_CUDA)
  return in_shared_memory;
#else
  auto address = static_cast<unsigned>(__cvta_generic_to_shared(&in_shared_memory));
  address = __shfl_sync(kWholeWarp, address, 0);
  return *static_cast<T*>(__cvta_shared_to_generic(address));
#endif
}

/// A value that other threads or the host change meanwhile.
template <class T>
__device__ inline T read_now(const T* value) {
  return *static_cast<const volatile T*>(value);
}

/// Adds to a counter that blocks share, and returns its old value. A thread that sees the new value
/// by this or by read_acquire sees all that was written before.
__device__ inline unsigned long long add_release(unsigned long long* count,
                                                 unsigned long long value) {
#if defined(PALPATE_EMULATE_CUDA)
  return atomicAdd(count, value);
#else
  unsigned long long before;
  asm volatile("atom.add.acq_rel.gpu.u64 %0, [%1], %2;"
               : "=l"(before)
               : "l"(count), "l"(value)
               : "memory");
  return before;
#endif
}
__device__ inline unsigned long long read_acquire(const unsigned long long* count) {
#if defined(PALPATE_EMULATE_CUDA)
  emulator::yield();
  return read_now(count);
#else
  unsigned long long value;
  asm volatile("ld.acquire.gpu.u64 %0, [%1];" : "=l"(value) : "l"(count) : "memory");
  return value;
#endif
}

/// Every thread of a cooperative grid arrives here before any goes on; what was written before is
/// visible after. `count` starts at 0.
__device__ inline void grid_barrier(unsigned long long* count) {
  __syncthreads();
  if (threadIdx.x == 0) {
    // All blocks together add this: the highest bit changes when the last one comes.
    constexpr unsigned long long kTurn = 1ull << 63;
    const unsigned long long mine = blockIdx.x == 0 ? kTurn - (gridDim.x - 1) : 1;
    const unsigned long long before = add_release(count, mine);
    unsigned long long now = before + mine;
    while (((before ^ now) & kTurn) == 0) now = read_acquire(count);
  }
  __syncthreads();
}

/// True in all threads of the block that calls this last of `num` blocks; it sees what the others
/// wrote before. `count` starts at 0 and is 0 again then. `shared` is for this alone.
__device__ inline bool is_last_block(unsigned long long* count, int* shared, unsigned num) {
  __syncthreads();
  if (threadIdx.x == 0) {
    *shared = add_release(count, 1) == num - 1;
    if (*shared != 0) *count = 0;
  }
  __syncthreads();
  return *shared != 0;
}
__device__ inline bool is_last_block(unsigned long long* count, int* shared) {
  return is_last_block(count, shared, gridDim.x);
}

/// The sum over the warp, in all lanes, always in the same order.
template <class T>
__device__ inline T warp_sum(T value) {
  for (int step = kWarpSize / 2; step > 0; step /= 2) {
    value += __shfl_xor_sync(kWholeWarp, value, step);
  }
  return value;
}

}}}  // namespace palpate::v0::gpu
