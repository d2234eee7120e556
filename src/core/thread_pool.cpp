#include "palpate/core/thread_pool.h"

#include <algorithm>
#include <atomic>
#include <cstdint>
#include <system_error>
#include <thread>
#include <vector>

namespace palpate {
namespace {

constexpr int kSpins = 2000;  // a few microseconds before a waiting thread goes to sleep

void relax() {
#if defined(__x86_64__)
  __builtin_ia32_pause();
#endif
}

}  // namespace

// A loop is published by raising `generation`. Each worker takes task numbers from `next_task`
// until none is left, then signs off in `num_busy`; the caller returns when all have signed off,
// so no worker can still look at a loop that has ended.
struct ThreadPool::Workers {
  ~Workers() {
    stop.store(true, std::memory_order_release);
    generation.fetch_add(1, std::memory_order_acq_rel);
    generation.notify_all();
    for (std::thread& thread : threads) thread.join();
  }

  std::vector<std::thread> threads;
  std::atomic<std::uint32_t> generation{0};
  std::atomic<int> num_busy{0};
  std::atomic<int> next_task{0};
  std::atomic<bool> stop{false};
  int num_tasks = 0;
  void* context = nullptr;
  void (*call)(void*, int) = nullptr;

  void take_tasks() {
    for (int task = next_task.fetch_add(1, std::memory_order_relaxed); task < num_tasks;
         task = next_task.fetch_add(1, std::memory_order_relaxed)) {
      call(context, task);
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
      take_tasks();
      if (num_busy.fetch_sub(1, std::memory_order_acq_rel) == 1) num_busy.notify_one();
    }
  }
};

ThreadPool::ThreadPool(int num_threads) : workers_(std::make_unique<Workers>()) {
  if (num_threads <= 0) {
    num_threads = std::max(1, static_cast<int>(std::thread::hardware_concurrency()));
  }
  try {
    for (int i = 1; i < num_threads; ++i) {
      workers_->threads.emplace_back([workers = workers_.get()] { workers->work(); });
    }
  } catch (const std::system_error&) {
    // The system starts no more. Results do not depend on their number.
  }
}

ThreadPool::~ThreadPool() = default;

int ThreadPool::num_threads() const { return static_cast<int>(workers_->threads.size()) + 1; }

void ThreadPool::run(int num_tasks, void* context, void (*call)(void*, int)) {
  if (workers_->threads.empty() || num_tasks <= 1) {
    for (int task = 0; task < num_tasks; ++task) call(context, task);
    return;
  }
  workers_->num_tasks = num_tasks;
  workers_->context = context;
  workers_->call = call;
  workers_->next_task.store(0, std::memory_order_relaxed);
  workers_->num_busy.store(static_cast<int>(workers_->threads.size()), std::memory_order_relaxed);
  workers_->generation.fetch_add(1, std::memory_order_acq_rel);
  workers_->generation.notify_all();

  workers_->take_tasks();
  for (int spin = 0; spin < kSpins; ++spin) {
    if (workers_->num_busy.load(std::memory_order_acquire) == 0) return;
    relax();
  }
  for (int busy = workers_->num_busy.load(std::memory_order_acquire); busy != 0;
       busy = workers_->num_busy.load(std::memory_order_acquire)) {
    workers_->num_busy.wait(busy, std::memory_order_acquire);
  }
}

}  // namespace palpate
