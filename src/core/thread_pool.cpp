#include "palpate/core/core.h"

#include <algorithm>
#include <atomic>
#include <cstdint>
#include <exception>
#include <system_error>
#include <thread>
#include <utility>
#include <vector>

#include "src/core/internal/assert.h"
#include "src/core/internal/num_cores.h"

namespace palpate { inline namespace v0 {
namespace {

constexpr int kSpins = 2000;  // a few microseconds before a waiting thread goes to sleep

void relax() {
#if defined(__x86_64__)
  __builtin_ia32_pause();
#endif
}

}  // namespace

// A loop is open from when `num_inside` is set to 0 until the caller, who finds no task left, adds
// kClosed. Each worker that `generation` has woken enters if the loop is still open, takes task
// numbers from `next_task` until none is left, and leaves. The caller waits for those inside, who
// have begun: one that wakes up late finds the door closed, or the next loop open.
struct ThreadPool::Workers {
  static constexpr std::uint32_t kClosed = 1u << 31;

  ~Workers() {
    stop.store(true, std::memory_order_release);
    generation.fetch_add(1, std::memory_order_acq_rel);
    generation.notify_all();
    for (std::thread& thread : threads) thread.join();
  }

  std::vector<std::thread> threads;
  std::atomic<std::uint32_t> generation{0};
  std::atomic<std::uint32_t> num_inside{kClosed};
  std::atomic<int> next_task{0};
  std::atomic<bool> stop{false};
  std::atomic<bool> has_thrown{false};
  std::exception_ptr thrown;  // by the first task that did; the caller of the loop gets it
  int num_tasks = 0;
  void* context = nullptr;
  void (*call)(void*, int) = nullptr;

  void take_tasks() noexcept {
    try {
      for (int task = next_task.fetch_add(1, std::memory_order_relaxed); task < num_tasks;
           task = next_task.fetch_add(1, std::memory_order_relaxed)) {
        call(context, task);
      }
    } catch (...) {
      if (!has_thrown.exchange(true)) thrown = std::current_exception();
      next_task.store(num_tasks, std::memory_order_relaxed);  // the others are left out
    }
  }

  bool enter() {
    std::uint32_t num = num_inside.load(std::memory_order_acquire);
    while ((num & kClosed) == 0) {
      if (num_inside.compare_exchange_weak(num, num + 1, std::memory_order_acq_rel,
                                           std::memory_order_acquire)) {
        return true;
      }
    }
    return false;
  }
  void leave() {
    if (num_inside.fetch_sub(1, std::memory_order_acq_rel) == (kClosed | 1)) {
      num_inside.notify_one();
    }
  }

  void work() {
    std::uint32_t seen = 0;
    for (;;) {
      for (int spin = 0; spin < kSpins && generation.load(std::memory_order_acquire) == seen;
           ++spin) {
        relax();
      }
      generation.wait(seen, std::memory_order_acquire);
      seen = generation.load(std::memory_order_acquire);
      if (stop.load(std::memory_order_acquire)) return;
      if (!enter()) continue;
      take_tasks();
      leave();
    }
  }

  /// Closes the loop; called by its caller.
  void close() {
    std::uint32_t num = num_inside.fetch_or(kClosed, std::memory_order_acq_rel) | kClosed;
    for (int spin = 0; spin < kSpins && num != kClosed; ++spin) {
      relax();
      num = num_inside.load(std::memory_order_acquire);
    }
    while (num != kClosed) {
      num_inside.wait(num, std::memory_order_acquire);
      num = num_inside.load(std::memory_order_acquire);
    }
  }
};

ThreadPool::ThreadPool(int num_threads, void (*begin)()) : workers_(std::make_unique<Workers>()) {
  if (num_threads <= 0) num_threads = num_cores();
  try {
    for (int i = 1; i < num_threads; ++i) {
      workers_->threads.emplace_back([workers = workers_.get(), begin] {
        if (begin != nullptr) begin();
        workers->work();
      });
    }
  } catch (const std::system_error&) {
    // The system starts no more. Results do not depend on their number.
  }
}

ThreadPool::~ThreadPool() = default;

int num_cores() { return std::max(1, static_cast<int>(std::thread::hardware_concurrency())); }

int ThreadPool::num_threads() const { return static_cast<int>(workers_->threads.size()) + 1; }

void ThreadPool::run(int num_tasks, void* context, void (*call)(void*, int)) {
  if (workers_->threads.empty() || num_tasks <= 1) {
    for (int task = 0; task < num_tasks; ++task) call(context, task);
    return;
  }
  // Open: a task of this pool, or another thread, has called it.
  PALPATE_ASSERT(workers_->num_inside.load(std::memory_order_relaxed) == Workers::kClosed);
  workers_->num_tasks = num_tasks;
  workers_->context = context;
  workers_->call = call;
  workers_->next_task.store(0, std::memory_order_relaxed);
  workers_->num_inside.store(0, std::memory_order_release);
  workers_->generation.fetch_add(1, std::memory_order_acq_rel);
  workers_->generation.notify_all();
  workers_->take_tasks();
  workers_->close();
  if (workers_->has_thrown.exchange(false)) {
    std::rethrow_exception(std::exchange(workers_->thrown, nullptr));
  }
}

}}  // namespace palpate::v0
