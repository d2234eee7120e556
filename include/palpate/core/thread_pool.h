// A fixed set of worker threads for loops whose tasks are independent.
#pragma once

#include <memory>
#include <type_traits>

namespace palpate {

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

}  // namespace palpate
