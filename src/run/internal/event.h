// Events: threads sleep until there is something to do, and wake each other without a lock.
#pragma once

#include <atomic>
#include <chrono>
#include <condition_variable>
#include <cstdint>
#include <mutex>

namespace palpate { inline namespace v0 {

/// One thread sleeps until another one rings. Ringing never waits. A ring between `count` and
/// `wait` is not missed:
///   for (;;) { const auto count = event.count(); if (something_to_do()) break; event.wait(count);
///   }
class Event {
 public:
  void ring() noexcept {
    count_.fetch_add(1, std::memory_order_release);
    count_.notify_one();
  }
  std::uint32_t count() const noexcept { return count_.load(std::memory_order_acquire); }
  void wait(std::uint32_t count) const noexcept { count_.wait(count, std::memory_order_acquire); }

 private:
  std::atomic<std::uint32_t> count_ = 0;
};

/// For threads that may wait: sleep that ends early when the loop does.
class StopSignal {
 public:
  void stop() {
    {
      const std::lock_guard lock(mutex_);
      is_stopping_.store(true, std::memory_order_release);
    }
    changed_.notify_all();
  }
  bool is_stopping() const noexcept { return is_stopping_.load(std::memory_order_acquire); }
  /// True if it is time to stop.
  bool sleep_for(double seconds) {
    std::unique_lock lock(mutex_);
    return changed_.wait_for(lock, std::chrono::duration<double>(seconds),
                             [this] { return is_stopping(); });
  }

 private:
  std::atomic<bool> is_stopping_ = false;
  std::mutex mutex_;
  std::condition_variable changed_;
};

}}  // namespace palpate::v0
