// CUDA's words for kernels, on the processor: every thread of a grid is a fiber, and fibers change
// at barriers. For tests on machines without a GPU: the kernels that run are the real ones, only
// their speed is not. Included by device_code.cuh alone.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <functional>
#include <utility>

#define __global__
#define __device__
#define __host__
#define __forceinline__ inline
#define __noinline__
#define __launch_bounds__(...)
#define __grid_constant__

namespace palpate { inline namespace v0 { namespace emulator {

struct Index {
  unsigned x = 0, y = 0, z = 0;
};

/// Position of the running thread in its grid.
struct ThreadPlace {
  Index thread, block, block_size, grid_size;
};
const ThreadPlace& place();

/// Lets the other threads go on.
void yield();
void block_barrier();
/// Waits for the lanes of `mask`, all of which call.
void warp_barrier(unsigned mask);
/// Returns the 16 bytes of a lane of the running thread's warp.
void* lane_slot(int lane);
int lane();
/// Returns the shared memory of the running thread's block.
void* shared_memory();

/// Runs a grid. All blocks of a cooperative grid run at the same time, others one after the other.
/// The order of threads and blocks follows from `set_order`.
void run_grid(int blocks, int threads, std::size_t shared_bytes, bool cooperative,
              const std::function<void()>& kernel);
/// Threads are taken in a new order from now on: nothing may depend on it.
void set_order(std::uint32_t seed);
/// Acts as if the GPU were lost: grids do nothing until it is back.
void lose_gpu(bool is_lost);

template <class T>
T exchange(unsigned mask, T value, int from_lane) {
  static_assert(sizeof(T) <= 16);
  std::memcpy(lane_slot(lane()), &value, sizeof value);
  warp_barrier(mask);
  T got;
  std::memcpy(&got, lane_slot(from_lane), sizeof got);
  warp_barrier(mask);
  return got;
}

}}}  // namespace palpate::v0::emulator

#define threadIdx (palpate::emulator::place().thread)
#define blockIdx (palpate::emulator::place().block)
#define blockDim (palpate::emulator::place().block_size)
#define gridDim (palpate::emulator::place().grid_size)

inline void __syncthreads() { palpate::emulator::block_barrier(); }
inline void __syncwarp(unsigned mask = 0xffffffffu) { palpate::emulator::warp_barrier(mask); }
inline void __threadfence_system() {}

template <class T>
T __shfl_sync(unsigned mask, T value, int from) {
  return palpate::emulator::exchange(mask, value, from & 31);
}
template <class T>
T __shfl_xor_sync(unsigned mask, T value, int step) {
  return palpate::emulator::exchange(mask, value, palpate::emulator::lane() ^ step);
}
template <class T>
T __shfl_up_sync(unsigned mask, T value, unsigned step) {
  const int lane = palpate::emulator::lane(), from = lane - static_cast<int>(step);
  return palpate::emulator::exchange(mask, value, from < 0 ? lane : from);
}
inline unsigned __ballot_sync(unsigned mask, int predicate) {
  const int mine = predicate != 0;
  std::memcpy(palpate::emulator::lane_slot(palpate::emulator::lane()), &mine, sizeof mine);
  palpate::emulator::warp_barrier(mask);
  unsigned bits = 0;
  for (int lane = 0; lane < 32; ++lane) {
    if ((mask >> lane & 1u) == 0) continue;
    int set;
    std::memcpy(&set, palpate::emulator::lane_slot(lane), sizeof set);
    bits |= static_cast<unsigned>(set) << lane;
  }
  palpate::emulator::warp_barrier(mask);
  return bits;
}
inline int __any_sync(unsigned mask, int predicate) { return __ballot_sync(mask, predicate) != 0; }
inline int __all_sync(unsigned mask, int predicate) {
  return __ballot_sync(mask, predicate) == mask;
}

inline int __popc(unsigned v) { return __builtin_popcount(v); }
inline int __ffs(int v) { return __builtin_ffs(v); }
inline int __clz(int v) { return v == 0 ? 32 : __builtin_clz(static_cast<unsigned>(v)); }
inline float __frcp_rn(float a) { return 1.0f / a; }
inline int __float2int_rn(float v) { return static_cast<int>(std::nearbyint(v)); }
inline float __int_as_float(int v) {
  float f;
  std::memcpy(&f, &v, sizeof f);
  return f;
}
inline int __float_as_int(float f) {
  int v;
  std::memcpy(&v, &f, sizeof v);
  return v;
}

// One operating system thread runs all fibers: plain operations are atomic.
template <class T>
T atomicExch(T* to, T value) {
  return std::exchange(*to, value);
}
template <class T>
T atomicAdd(T* to, T value) {
  return atomicExch(to, static_cast<T>(*to + value));
}
template <class T>
T atomicOr(T* to, T value) {
  return atomicExch(to, *to | value);
}
template <class T>
T atomicMin(T* to, T value) {
  return atomicExch(to, std::min(*to, value));
}
template <class T>
T atomicMax(T* to, T value) {
  return atomicExch(to, std::max(*to, value));
}
