// The interface of the CUDA backend to its runtime: memory, streams, launches. Two implementations:
// CUDA's own (runtime_cuda.cpp), and the emulator that tests use where no GPU is
// (runtime_emulated.cpp).
//
// Nothing here throws. A failure (no memory left, a lost device) is kept by the object that met it
// and reported by `status()`; later calls on it then do nothing.
#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <memory>
#include <span>
#include <tuple>
#include <type_traits>
#include <utility>
#include <vector>

#include "palpate/core/core.h"

namespace palpate { inline namespace v0 { namespace gpu {

/// Owns any number of arrays on one GPU and in page-locked host memory.
class Memory {
 public:
  explicit Memory(int gpu) : gpu_(gpu) {}
  Memory(Memory&&) noexcept;
  Memory& operator=(Memory&&) noexcept;
  ~Memory();

  /// `num` zeroed values on the GPU; null after a failure.
  template <class T>
  T* take(std::size_t num) {
    static_assert(std::is_trivially_copyable_v<T>);
    return static_cast<T*>(take_bytes(num * sizeof(T), false));
  }
  /// A copy of `values` on the GPU.
  template <class T>
  T* copy_of(std::span<const T> values) {
    T* const copy = take<T>(values.size());
    if (copy != nullptr) upload(copy, values.data(), values.size_bytes());
    return copy;
  }
  template <class T>
  T* copy_of(const std::vector<T>& values) {
    return copy_of(std::span<const T>(values));
  }
  /// Copies into an array of this; waits. Failures are left in `status`.
  void upload(void* to, const void* from, std::size_t num_bytes);
  /// `num` zeroed values in page-locked host memory, which kernels of this GPU may read and write
  /// at the same address (over the bus); null after a failure.
  template <class T>
  T* take_pinned(std::size_t num) {
    static_assert(std::is_trivially_copyable_v<T>);
    return static_cast<T*>(take_bytes(num * sizeof(T), true));
  }

  /// The first failure: how much memory was requested and what to do.
  const Status& status() const { return status_; }
  int gpu() const { return gpu_; }

 private:
  struct Block {
    void* data;
    bool pinned;
  };

  void* take_bytes(std::size_t num_bytes, bool pinned);
  void release();

  int gpu_;
  std::vector<Block> blocks_;
  Status status_ = Done{};
};

/// Launch configuration of a kernel. All blocks of a cooperative one run at the same time and may
/// wait for each other (team.cuh, grid_barrier); see resident_blocks.
struct LaunchShape {
  int blocks = 1;
  int threads = 128;  ///< per block, a multiple of 32
  std::size_t shared_bytes = 0;
  bool cooperative = false;
};

enum class Priority { low, high };

/// A recorded sequence of copies and launches that runs as one.
class Graph {
 public:
  Graph();
  Graph(Graph&&) noexcept;
  Graph& operator=(Graph&&) noexcept;
  ~Graph();

 private:
  friend class Stream;
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

/// A queue of work on one GPU, done in order. Streams of high priority overtake others. No call
/// waits, except `wait`, or allocates, except recording and the emulator.
class Stream {
 public:
  Stream(int gpu, Priority priority);
  /// Makes a stream that works only in queues of others; see `continue_in`.
  explicit Stream(int gpu);
  /// Makes one for a few launches in a queue of somebody else: cheap, without marks. Its end leaves
  /// the thread's current device as it was.
  Stream(int gpu, void* handle);
  Stream(Stream&&) noexcept;
  Stream& operator=(Stream&&) noexcept;
  ~Stream();

  /// Copies between any two of host, this GPU and other GPUs. Host memory should be page-locked.
  void copy(void* to, const void* from, std::size_t num_bytes) noexcept;
  /// Sets all bytes to 0.
  void clear(void* data, std::size_t num_bytes) noexcept;
  /// Work submitted from now on runs in this queue of somebody else, after the last mark if it is
  /// not recording; failures are forgotten. On CUDA `handle` is a cudaStream_t.
  void continue_in(void* handle) noexcept;
  void* handle() const noexcept;
  /// Is submitted work recorded, not run?
  bool is_recording() noexcept;
  /// Waits for all submitted work, but not longer: then the device counts as lost.
  const Status& wait(double seconds = 2) noexcept;
  /// True if all submitted work is done. Does not wait.
  bool is_idle() noexcept;
  /// Marks the stream as failed; e.g. when a result has not come in time.
  void fail(Error error) noexcept;

  /// Work submitted between these two is not run but recorded.
  void begin_recording() noexcept;
  Graph end_recording() noexcept;
  void launch(const Graph& graph) noexcept;

  /// Runs a kernel: a function marked __global__. Called by gpu::launch.
  void launch_kernel(const LaunchShape& shape, const void* kernel, void** arguments) noexcept;
  void run_emulated(const LaunchShape& shape, std::function<void()> kernel);

  /// Marks an end of work, if not recording. `lap`: us on the device since then; waits.
  void mark() noexcept;
  double lap() noexcept;
  /// Runs each kernel so many times from now on, for benchmarks: what a query takes on the device
  /// shows in many launches in a row alone.
  void repeat_kernels(int num) { num_repeats_ = num; }

  const Status& status() const { return status_; }
  int gpu() const { return gpu_; }

 private:
  struct Impl;
  int gpu_;
  std::unique_ptr<Impl> impl_;
  int num_repeats_ = 1;
  Status status_ = Done{};
};

/// launch(stream, {.blocks = 4}, kernel, arguments ...): asynchronous; failures go to the stream.
template <class... Parameters, class... Arguments>
void launch(Stream& stream, const LaunchShape& shape, void (*kernel)(Parameters...),
            Arguments&&... arguments) noexcept {
  std::tuple<std::remove_const_t<Parameters>...> values{std::forward<Arguments>(arguments)...};
#if defined(PALPATE_EMULATE_CUDA)
  stream.run_emulated(shape, [kernel, values] { std::apply(kernel, values); });
#else
  std::apply(
      [&](auto&... value) {
        void* pointers[] = {const_cast<void*>(static_cast<const void*>(&value))..., nullptr};
        stream.launch_kernel(shape, reinterpret_cast<const void*>(kernel), pointers);
      },
      values);
#endif
}

/// Returns the largest number of blocks of a kernel that run on the GPU at the same time; 0 after a
/// failure. Raises the kernel's limit of shared memory to `shared_bytes`.
int resident_blocks(int gpu, const void* kernel, int threads, std::size_t shared_bytes);

/// Bytes that can still be taken on a GPU; 0 after a failure.
std::size_t free_memory(int gpu);

/// Is there such a GPU, fit for this build? The error says what is missing.
Status check_gpu(int gpu);

}}}  // namespace palpate::v0::gpu
