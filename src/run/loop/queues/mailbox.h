// Hands a new object from a thread that may wait to one that never waits.
#pragma once

#include <atomic>

namespace palpate { inline namespace v0 {

/// One giver, one taker. An offered object belongs to the taker until it is settled: the taker
/// swaps its old contents into it, and the giver finds them there, to keep or to destroy.
template <class T>
class Mailbox {
 public:
  /// Giver: only when the last one is settled; it must live until then.
  void offer(T& news) noexcept { offered_.store(&news, std::memory_order_release); }
  bool is_settled() const noexcept { return offered_.load(std::memory_order_acquire) == nullptr; }

  /// Taker: returns the offer or null; `settle` gives it back.
  T* look() const noexcept { return offered_.load(std::memory_order_acquire); }
  void settle() noexcept { offered_.store(nullptr, std::memory_order_release); }

 private:
  std::atomic<T*> offered_ = nullptr;
};

}}  // namespace palpate::v0
