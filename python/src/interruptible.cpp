#include "python/src/interruptible.h"

#include <unistd.h>

#include <chrono>
#include <condition_variable>
#include <mutex>
#include <string>
#include <system_error>
#include <thread>

#include "python/src/arrays.h"

namespace palpate::python {
namespace {

/// All unfinished work of this process.
struct Running {
  const pid_t process = getpid();
  std::mutex mutex;
  std::condition_variable changed;
  int num = 0;

  /// Waits with the GIL, which it releases. Throws KeyboardInterrupt.
  template <class IsOver>
  void wait(const IsOver& is_over) {
    constexpr std::chrono::milliseconds kLook{50};  // between two looks at Ctrl-C
    const auto wait_a_little = [&] {
      const nb::gil_scoped_release no_gil;
      std::unique_lock lock(mutex);
      return changed.wait_for(lock, kLook, is_over);
    };
    while (!wait_a_little()) {
      if (is_interrupted()) throw nb::python_error();
    }
  }
};

Running& running() {
  static Running& all = *new Running;  // threads may outlast everything else
  return all;
}

}  // namespace

void do_interruptibly(std::function<void()> work) {
  Running& all = running();
  const auto is_done = std::make_shared<bool>(false);
  {
    const std::lock_guard lock(all.mutex);
    ++all.num;
  }
  const auto finish = [&all, is_done] {
    const std::lock_guard lock(all.mutex);
    *is_done = true;
    --all.num;
    all.changed.notify_all();
  };
  try {
    std::thread([finish, work = std::move(work)]() mutable {
      work();
      work = {};
      finish();
    }).detach();
  } catch (const std::system_error& error) {
    finish();
    throw PalpateError(std::string("no thread is to be had: ") + error.what());
  }
  all.wait([&] { return *is_done; });
}

void wait_for_interrupted_work() {
  Running& all = running();
  if (all.process != getpid()) return;  // after os.fork: its threads are the parent's
  all.wait([&] { return all.num == 0; });
}

}  // namespace palpate::python
