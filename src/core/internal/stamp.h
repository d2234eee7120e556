// Which values a view shows: a number that no other values of this process had.
#pragma once

#include <atomic>
#include <cstdint>

namespace palpate::inline v0 {

/// A new stamp, never 0. From any thread.
inline std::uint64_t next_stamp() noexcept {
  static std::atomic<std::uint64_t> last{0};
  return ++last;
}

}  // namespace palpate::inline v0
