// Memory that is short on the devices of the emulator, for tests of what happens then.
#pragma once

#include <cstddef>

namespace palpate { inline namespace v0 { namespace emulator {

/// Lets arrays of more bytes find no memory, as long as it lives. One at a time.
class ShortMemory {
 public:
  explicit ShortMemory(std::size_t max_bytes);
  ~ShortMemory();
  ShortMemory(const ShortMemory&) = delete;
  ShortMemory& operator=(const ShortMemory&) = delete;
};

/// Returns the bytes of the largest array that finds memory.
std::size_t largest_array();

}}}  // namespace palpate::v0::emulator
