// Work of a figure on several threads, for what is not timed.
#pragma once

#include <atomic>
#include <functional>

#include "eval/context.h"

namespace palpate::eval {

/// How far the tasks of one run_tasks are. Any thread.
class Work {
 public:
  /// One step is done. Throws Cancelled if the caller requested a stop: let it pass.
  void step() {
    if (stopped_.load(std::memory_order_relaxed)) throw Cancelled{};
    num_done_.fetch_add(1, std::memory_order_relaxed);
  }

 private:
  friend void run_tasks(Context&, int, double, const std::function<void(int, Work&)>&);
  std::atomic<bool> stopped_{false};
  std::atomic<long> num_done_{0};
};

/// Runs task(0) ... task(num_tasks - 1), each once, in any order, on as many threads as the
/// settings say, and returns when all have ended; each task writes to a place of its own. This
/// thread reports the progress meanwhile: `num_steps` is how often the tasks will call Work::step,
/// about. Throws Cancelled, and what a task throws.
void run_tasks(Context& context, int num_tasks, double num_steps,
               const std::function<void(int task, Work& work)>& task);

}  // namespace palpate::eval
