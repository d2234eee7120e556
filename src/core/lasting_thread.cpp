#include "src/core/lasting_thread.h"

#include <system_error>
#include <utility>

namespace palpate::inline v0 {

LastingThread::LastingThread() {
  try {
    std::thread thread([this] { serve(); });
    id_ = thread.get_id();
    has_thread_ = true;
    thread.detach();
  } catch (const std::system_error&) {  // none to be had: the caller does it
  }
}

void LastingThread::run(std::function<void()> work) {
  if (!has_thread_ || std::this_thread::get_id() == id_) return work();
  const std::lock_guard turn(one_at_a_time_);
  std::unique_lock lock(mutex_);
  work_ = std::move(work);
  changed_.notify_all();
  changed_.wait(lock, [&] { return !work_; });
  if (thrown_) std::rethrow_exception(std::exchange(thrown_, nullptr));
}

void LastingThread::serve() {
  std::unique_lock lock(mutex_);
  for (;;) {
    changed_.wait(lock, [&] { return static_cast<bool>(work_); });
    lock.unlock();
    std::exception_ptr thrown;
    try {
      work_();
    } catch (...) {
      thrown = std::current_exception();
    }
    lock.lock();
    thrown_ = std::move(thrown);
    work_ = {};
    changed_.notify_all();
  }
}

}  // namespace palpate::inline v0
