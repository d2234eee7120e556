// Parallel tasks of a figure, for work that is not timed.
#pragma once

#include <atomic>
#include <functional>

#include "eval/context.h"

namespace palpate::eval {

/// Progress of the tasks of one run_tasks. Thread-safe.
class Work {
 public:
  /// Counts a step. Throws Cancelled if the caller requested a stop: let it pass.
  void step() {
    if (stopped_.load(std::memory_order_relaxed)) throw Cancelled{};
    num_done_.fetch_add(1, std::memory_order_relaxed);
  }

 private:
  friend void run_tasks(Context&, int, double, const std::function<void(int, Work&)>&);
  std::atomic<bool> stopped_{false};
  std::atomic<long> num_done_{0};
};

/// Runs task(0) ... task(num_tasks - 1), each once, in any order, on the number of threads of the
/// settings, and returns when all have ended; each task writes to its own memory. This thread
/// reports the progress meanwhile: `num_steps` is the approximate number of Work::step calls.
/// Throws Cancelled, and exceptions of a task.
void run_tasks(Context& context, int num_tasks, double num_steps,
               const std::function<void(int task, Work& work)>& task);

}  // namespace palpate::eval
