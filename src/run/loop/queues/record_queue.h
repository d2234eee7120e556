// A bounded queue that hands all values from one thread to another.
#pragma once

#include <atomic>
#include <cstddef>
#include <cstdint>
#include <vector>

namespace palpate { inline namespace v0 {

/// One writer, one reader, wait-free. All memory is allocated at construction. What does not fit is
/// counted as lost: the writer never waits for the reader.
template <class T>
class RecordQueue {
 public:
  /// `capacity` slots, each a copy of `initial`.
  explicit RecordQueue(std::size_t capacity, const T& initial = T{}) : slots_(capacity, initial) {}
  RecordQueue(const RecordQueue&) = delete;
  RecordQueue& operator=(const RecordQueue&) = delete;

  /// Writer: the slot to fill (it holds some older value) and then to `push`; null if none is free,
  /// which counts as one loss.
  T* draft() noexcept {
    const std::uint64_t written = num_written_.load(std::memory_order_relaxed);
    if (written - num_read_.load(std::memory_order_acquire) == slots_.size()) {
      num_lost_.fetch_add(1, std::memory_order_relaxed);
      return nullptr;
    }
    return &slots_[written % slots_.size()];
  }
  void push() noexcept {
    num_written_.store(num_written_.load(std::memory_order_relaxed) + 1, std::memory_order_release);
  }
  void push(const T& value) noexcept(noexcept(*draft() = value)) {
    if (T* slot = draft()) {
      *slot = value;
      push();
    }
  }

  /// Reader: the oldest value, until `pop`; null if there is none.
  const T* front() const noexcept {
    const std::uint64_t read = num_read_.load(std::memory_order_relaxed);
    if (read == num_written_.load(std::memory_order_acquire)) return nullptr;
    return &slots_[read % slots_.size()];
  }
  void pop() noexcept {
    num_read_.store(num_read_.load(std::memory_order_relaxed) + 1, std::memory_order_release);
  }

  std::uint64_t num_lost() const noexcept { return num_lost_.load(std::memory_order_relaxed); }

 private:
  std::vector<T> slots_;
  alignas(64) std::atomic<std::uint64_t> num_written_ = 0;  // by the writer
  alignas(64) std::atomic<std::uint64_t> num_read_ = 0;     // by the reader
  std::atomic<std::uint64_t> num_lost_ = 0;
};

}}  // namespace palpate::v0
