// Triple buffer: hands the newest value from one thread to another; neither waits (thesis
// Fig. 4.1).
#pragma once

#include <atomic>
#include <cstdint>

namespace palpate { inline namespace v0 {

/// One writer, one reader. Three slots: the writer fills one, the reader reads one, and the newest
/// finished one lies between them. Wait-free, no allocation after construction. Values that the
/// reader does not come for are lost: newest wins.
template <class T>
class TripleBuffer {
 public:
  explicit TripleBuffer(const T& initial = T{}) : slots_{initial, initial, initial} {}
  TripleBuffer(const TripleBuffer&) = delete;
  TripleBuffer& operator=(const TripleBuffer&) = delete;

  /// Writer: the slot to fill (it holds some older value), and to hand it over.
  T& draft() { return slots_[draft_]; }
  void publish() {
    draft_ =
        between_.exchange(static_cast<std::uint8_t>(draft_ | kFresh), std::memory_order_acq_rel) &
        kIndex;
  }
  void publish(const T& value) {
    draft() = value;
    publish();
  }

  /// Reader: takes the newest value if there is a new one; true if so.
  bool refresh() {
    if ((between_.load(std::memory_order_acquire) & kFresh) == 0) return false;
    read_ = between_.exchange(read_, std::memory_order_acq_rel) & kIndex;
    return true;
  }
  /// Reader: the value taken last, its own until the next one is taken.
  const T& value() const { return slots_[read_]; }
  T& value() { return slots_[read_]; }

 private:
  static constexpr std::uint8_t kFresh = 4, kIndex = 3;

  T slots_[3];
  std::uint8_t draft_ = 0;                 // writer's
  std::atomic<std::uint8_t> between_ = 1;  // slot and kFresh
  std::uint8_t read_ = 2;                  // reader's
};

}}  // namespace palpate::v0
