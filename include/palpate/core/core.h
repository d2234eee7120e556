// What everything stands on: results and errors, code for host and device, instruction sets,
// threads, latencies.
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

// A function marked PALPATE_HOSTDEV is compiled by the C++ compiler and by nvcc from the same
// lines.
#if defined(__CUDACC__)
#define PALPATE_HOSTDEV __host__ __device__
#else
#define PALPATE_HOSTDEV
#endif

// The same for formulas that vector kernels use too: always part of the caller, because a copy of
// its own would be one for all instruction sets.
#if defined(__CUDACC__)
#define PALPATE_FORMULA __host__ __device__ inline
#else
#define PALPATE_FORMULA [[gnu::always_inline]] inline
#endif

namespace palpate::inline v0 {

/// What kind of thing went wrong; the message says the rest.
enum class Errc {
  invalid_argument,  ///< a parameter is out of its documented range
  not_found,         ///< a file, scene or device does not exist
  bad_input,         ///< a file or mesh was read and is not acceptable
  io_failure,        ///< reading or writing failed (disk full, permission)
  unavailable,       ///< this build or machine cannot do it
  cancelled,         ///< the caller asked to stop
};

/// One error: its kind, and one sentence that says what, where, and what to do next.
struct Error {
  Errc code = Errc::bad_input;
  std::string message;
};

/// Ends the program: somebody took the value of an error without looking, or the other way round.
[[noreturn]] inline void end_for_wrong_result(const char* wanted, const char* message) {
  std::fprintf(stderr, "palpate: a Result was asked for its %s, but has none: %s\n", wanted,
               message);
  std::abort();
}

// Errors at set-up travel as values. Members are named as in std::expected, so that it can take
// this class' place once every compiler we support has it.

/// Either a value or an Error. Check `has_value()` before `*`: asking for what is not there ends
/// the program with a message, in every build type.
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

/// The best level this processor and operating system support, or the one named by the environment
/// variable PALPATE_ISA (baseline, avx2, avx512) if that is lower.
Isa best_isa();

/// "baseline", "avx2" or "avx512".
const char* isa_name(Isa isa);

// A fixed set of worker threads for loops whose tasks are independent.

/// Runs `task(0) ... task(n-1)` on a fixed number of threads. Tasks are handed out in any order;
/// a caller that wants the same bits for any thread count gives each task its own output and
/// combines them in task order.
class ThreadPool {
 public:
  /// `num_threads` >= 1 counts the calling thread; 1 starts no thread at all. 0 means one per core.
  /// Where the system starts no more threads the pool works with those that it has. Each thread
  /// that it starts calls `begin` first, where that is given.
  explicit ThreadPool(int num_threads = 1, void (*begin)() = nullptr);
  ~ThreadPool();
  ThreadPool(const ThreadPool&) = delete;
  ThreadPool& operator=(const ThreadPool&) = delete;

  /// That it has, with the calling one.
  int num_threads() const;

  /// Runs the tasks and returns when all are done. No allocation. With one thread it is a plain
  /// loop; with more, the caller works too and then waits for tasks that others have begun. It
  /// never waits for a thread that has not woken up yet.
  /// Not reentrant: a task may not call parallel_for on the same pool.
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

// How long something takes, again and again: percentiles without keeping the samples.

/// Counts durations in buckets that are 1/32 of an octave wide (error <= 2.2 %), from 1 ns to 18 s.
/// One thread records, wait-free and without allocation; any thread may read meanwhile.
class LatencyHistogram {
 public:
  void record(std::int64_t nanoseconds) noexcept;

  struct Summary {
    std::uint64_t num = 0;
    double p50 = 0, p99 = 0, p999 = 0, max = 0, mean = 0;  ///< microseconds
  };
  Summary summary() const noexcept;
  std::uint64_t num_above(std::int64_t nanoseconds) const noexcept;

  static constexpr int kBucketsPerOctave = 32, kNumBuckets = 35 * kBucketsPerOctave;
  /// For drawing: samples in a bucket, and its lower end in nanoseconds.
  std::uint64_t count(int bucket) const noexcept;
  static double lower_end(int bucket) noexcept;

 private:
  std::array<std::atomic<std::uint64_t>, kNumBuckets> counts_{};
  std::atomic<std::int64_t> max_ = 0, sum_ = 0;
};

}  // namespace palpate::inline v0
