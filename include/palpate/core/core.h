// Basics for all modules: results and errors, macros for shared host/device code, vector
// instruction sets, a thread pool, latency histograms.
#pragma once

#include <array>
#include <atomic>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <memory>
#include <string>
#include <type_traits>
#include <utility>
#include <variant>

// A function marked PALPATE_HOSTDEV is compiled by the C++ compiler and by nvcc, from the same
// source lines.
#if defined(__CUDACC__)
#define PALPATE_HOSTDEV __host__ __device__
#else
#define PALPATE_HOSTDEV
#endif

// The same for formulas that vector kernels also use: always inlined, because an out-of-line copy
// would be shared by all instruction sets.
#if defined(__CUDACC__)
#define PALPATE_FORMULA __host__ __device__ inline
#else
#define PALPATE_FORMULA [[gnu::always_inline]] inline
#endif

namespace palpate { inline namespace v0 {

/// The kind of an error; the message has the details.
enum class Errc {
  invalid_argument,  ///< a parameter is out of its documented range
  not_found,         ///< a file, scene or device does not exist
  bad_input,         ///< a file or mesh was read and is not acceptable
  io_failure,        ///< reading or writing failed (disk full, permission)
  unavailable,       ///< this build or machine cannot do it
  cancelled,         ///< the caller requested a stop
};

/// One error: its kind, and one sentence that says what, where, and what to do next.
struct Error {
  Errc code = Errc::bad_input;
  std::string message;
};

/// Aborts the program: the caller took the value of an error without a check, or the reverse.
[[noreturn]] inline void end_for_wrong_result(const char* desired, const char* message) {
  std::fprintf(stderr, "palpate: a Result was asked for its %s, but has none: %s\n", desired,
               message);
  std::abort();
}

// Errors at set-up travel as values. Members are named as in std::expected, so that it can take
// this class' place once every compiler we support has it.

/// Either a value or an Error. Check `has_value()` before `*`: access to the missing one aborts the
/// program with a message, in every build type.
template <class T>
class [[nodiscard]] Result {
 public:
  Result(T value) : state_(std::move(value)) {}
  Result(Error error) : state_(std::move(error)) {}

  bool has_value() const { return state_.index() == 0; }
  explicit operator bool() const { return has_value(); }

  T& value() & { return check_value(), *std::get_if<0>(&state_); }
  const T& value() const& { return check_value(), *std::get_if<0>(&state_); }
  T&& value() && { return check_value(), std::move(*std::get_if<0>(&state_)); }

  T& operator*() & { return value(); }
  const T& operator*() const& { return value(); }
  T&& operator*() && { return std::move(*this).value(); }
  T* operator->() { return &value(); }
  const T* operator->() const { return &value(); }

  const Error& error() const {
    if (has_value()) end_for_wrong_result("error", "it is a value");
    return *std::get_if<1>(&state_);
  }

 private:
  void check_value() const {
    if (!has_value()) end_for_wrong_result("value", std::get_if<1>(&state_)->message.c_str());
  }

  std::variant<T, Error> state_;
};

/// For operations that only succeed or fail: `return Done{};`.
struct Done {};
using Status = Result<Done>;

/// Vector instruction levels, lowest first. `baseline` is x86-64-v2 (or NEON on 64-bit Arm).
enum class Isa { baseline, avx2, avx512 };

/// The best level that this CPU and operating system support, or a lower one set by the environment
/// variable PALPATE_ISA (baseline, avx2, avx512).
Isa best_isa();

/// "baseline", "avx2" or "avx512".
const char* isa_name(Isa isa);

// A fixed set of worker threads for loops whose tasks are independent.

/// Runs `task(0) ... task(n-1)` on a fixed number of threads, in any order. For the same bits
/// with any thread count, give each task its own output and combine the outputs in task
/// order.
class ThreadPool {
 public:
  /// `num_threads` >= 1 counts the calling thread; 1 starts no thread. 0 means one per core. If the
  /// system cannot start more threads, the pool works with those it has. Each started thread calls
  /// `begin` first, unless it is null.
  explicit ThreadPool(int num_threads = 1, void (*begin)() = nullptr);
  ~ThreadPool();
  ThreadPool(const ThreadPool&) = delete;
  ThreadPool& operator=(const ThreadPool&) = delete;

  /// Threads in the pool, including the calling one.
  int num_threads() const;

  /// Runs the tasks and returns when all are done. No allocation. With one thread it is a plain
  /// loop; with more, the caller also works and then waits for tasks already begun by others. It
  /// never waits for a thread that has not woken up yet. Not reentrant: a task must not call
  /// parallel_for on the same pool, which is asserted.
  template <class Task>
  void parallel_for(int num_tasks, Task&& task) {
    run(num_tasks, const_cast<void*>(static_cast<const void*>(&task)),
        [](void* context, int task_id) {
          (*static_cast<std::remove_reference_t<Task>*>(context))(task_id);
        });
  }

 private:
  void run(int num_tasks, void* context, void (*call)(void*, int));
  struct Workers;
  std::unique_ptr<Workers> workers_;
};

// Percentiles of repeated durations, without storing the samples.

/// Counts durations in buckets that are 1/32 of an octave wide (error <= 2.2 %), from 1 ns to 18 s.
/// One thread records, wait-free and without allocation; any thread may read concurrently.
class LatencyHistogram {
 public:
  /// Adds one duration.
  void record(std::int64_t nanoseconds) noexcept;

  /// Number of durations, and their percentiles, maximum and mean.
  struct Summary {
    std::uint64_t num = 0;
    double p50 = 0, p99 = 0, p999 = 0, max = 0, mean = 0;  ///< microseconds
  };
  Summary summary() const noexcept;
  /// Number of durations above this one, to the width of a bucket.
  std::uint64_t num_above(std::int64_t nanoseconds) const noexcept;

  static constexpr int kBucketsPerOctave = 32, kNumBuckets = 35 * kBucketsPerOctave;
  /// For plots: the number of samples in a bucket, and its lower bound in nanoseconds.
  std::uint64_t count(int bucket) const noexcept;
  static double lower_end(int bucket) noexcept;

 private:
  std::array<std::atomic<std::uint64_t>, kNumBuckets> counts_{};
  std::atomic<std::int64_t> max_ = 0, sum_ = 0;
};

}}  // namespace palpate::v0
