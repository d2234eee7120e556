#include "eval/studies/parallel.h"

#include <algorithm>
#include <chrono>
#include <condition_variable>
#include <exception>
#include <mutex>
#include <system_error>
#include <thread>
#include <vector>

namespace palpate::eval {

void run_tasks(Context& context, int num_tasks, double num_steps,
               const std::function<void(int, Work&)>& task) {
  Work work;
  std::atomic<int> next{0};
  std::mutex mutex;
  std::condition_variable ended;
  int num_running = 0;
  std::exception_ptr failure;  // the first
  const auto stop = [&](const std::exception_ptr& reason) {
    if (!failure) failure = reason;
    work.stopped_ = true;
    next = num_tasks;
  };
  const auto run = [&] {
    std::exception_ptr own;
    try {
      for (int i = next++; i < num_tasks; i = next++) task(i, work);
    } catch (...) {
      own = std::current_exception();
    }
    const std::lock_guard lock(mutex);
    if (own) stop(own);
    if (--num_running == 0) ended.notify_one();
  };

  const int desired = context.settings().num_threads;
  const int num_threads =
      desired > 0 ? desired : static_cast<int>(std::max(1u, std::thread::hardware_concurrency()));
  std::vector<std::thread> threads;
  num_running = std::min(num_threads, num_tasks);
  try {
    for (int i = num_running; i > 0; --i) threads.emplace_back(run);
  } catch (const std::system_error&) {  // the system's limit of threads is reached
    const std::lock_guard lock(mutex);
    num_running -= std::min(num_threads, num_tasks) - static_cast<int>(threads.size());
  }
  if (threads.empty() && num_tasks > 0) {
    num_running = 1;
    run();
  }
  {
    using namespace std::chrono_literals;
    std::unique_lock lock(mutex);
    while (!ended.wait_for(lock, 100ms, [&] { return num_running == 0; })) {
      if (failure) continue;
      try {
        context.progress(std::min(1.0, static_cast<double>(work.num_done_) / num_steps));
      } catch (...) {
        stop(std::current_exception());
      }
    }
  }
  for (std::thread& thread : threads) thread.join();
  if (failure) std::rethrow_exception(failure);
}

}  // namespace palpate::eval
