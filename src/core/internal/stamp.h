// Version stamps: a number that is unique in this process for each set of values.
#pragma once

#include <atomic>
#include <cstdint>

namespace palpate { inline namespace v0 {

/// A new stamp, never 0. From any thread.
inline std::uint64_t next_stamp() noexcept {
  static std::atomic<std::uint64_t> last{0};
  return ++last;
}

}}  // namespace palpate::v0
