#include "src/core/internal/bounded_call.h"

#include <algorithm>
#include <atomic>
#include <chrono>
#include <exception>
#include <future>
#include <memory>
#include <system_error>
#include <utility>

namespace palpate { inline namespace v0 {
namespace {

std::atomic<int> g_num_hung{0};

}  // namespace

/// One call. Either its return or the end of the patience settles it, whichever comes first.
class BoundedCall::Call {
 public:
  explicit Call(std::function<void()> work) : work_(std::move(work)) {}

  void run() noexcept {
    std::exception_ptr thrown;
    try {
      work_();
    } catch (...) {
      thrown = std::current_exception();
    }
    work_ = nullptr;  // frees what it owns before the waiting thread is notified
    if (is_settled_.exchange(true)) count_hung_calls(-1);
    if (thrown) {
      has_returned_.set_exception(std::move(thrown));
    } else {
      has_returned_.set_value();
    }
  }
  bool returns_within(double patience) {
    // Waits in short steps: time in which the whole process stands still does not count.
    constexpr double kWait = 0.01;
    bool is_ready = false;
    for (double left = patience; left > 0 && !is_ready; left -= kWait)
      is_ready = returned_.wait_for(std::chrono::duration<double>(std::min(kWait, left))) ==
                 std::future_status::ready;
    if (is_ready || is_settled_.exchange(true)) {
      returned_.get();  // throws what the call has thrown
      return true;
    }
    count_hung_calls(1);
    return false;
  }
  void wait() { returned_.get(); }

 private:
  std::function<void()> work_;
  std::atomic<bool> is_settled_ = false;
  std::promise<void> has_returned_;
  std::future<void> returned_ = has_returned_.get_future();
};

BoundedCall::BoundedCall(std::function<void()> work)
    : call_(std::make_shared<Call>(std::move(work))) {
  try {
    std::thread([call = call_] { call->run(); }).detach();
  } catch (const std::system_error&) {
    call_->run();
  }
}

bool BoundedCall::returns_within(double patience) { return call_->returns_within(patience); }

bool LibraryThread::returns_within(double patience, std::function<void()> work) {
  return start(std::move(work))->returns_within(patience);
}

void LibraryThread::wait_for(std::function<void()> work) { start(std::move(work))->wait(); }

std::shared_ptr<BoundedCall::Call> LibraryThread::start(std::function<void()> work) {
  auto call = std::make_shared<BoundedCall::Call>(std::move(work));
  if (!hand_over([call] { call->run(); })) call->run();
  return call;
}

/// Queues the call. False: the caller is this thread, or the system starts none.
bool LibraryThread::hand_over(std::function<void()> call) {
  const std::lock_guard lock(mutex_);
  if (id_ == std::this_thread::get_id()) return false;
  if (id_ == std::thread::id()) {
    try {
      std::thread thread([this] { serve(); });
      id_ = thread.get_id();
      thread.detach();
    } catch (const std::system_error&) {
      return false;
    }
  }
  calls_.push(std::move(call));
  changed_.notify_one();
  return true;
}

void LibraryThread::serve() {
  std::unique_lock lock(mutex_);
  for (;;) {
    changed_.wait(lock, [this] { return !calls_.empty(); });
    const std::function<void()> next = std::move(calls_.front());
    calls_.pop();
    lock.unlock();
    next();
    lock.lock();
  }
}

bool is_any_call_hung() noexcept { return g_num_hung > 0; }
void count_hung_calls(int change) noexcept { g_num_hung += change; }

}}  // namespace palpate::v0
