// A thread pool where a system has no threads: its caller does all tasks, one after the other.
#include "src/core/internal/num_cores.h"

namespace palpate { inline namespace v0 {

struct ThreadPool::Workers {};

ThreadPool::ThreadPool(int, void (*)()) {}

ThreadPool::~ThreadPool() = default;

int num_cores() { return 1; }

int ThreadPool::num_threads() const { return 1; }

void ThreadPool::run(int num_tasks, void* context, void (*call)(void*, int)) {
  for (int task = 0; task < num_tasks; ++task) call(context, task);
}

}}  // namespace palpate::v0
