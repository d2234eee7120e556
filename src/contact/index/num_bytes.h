// The memory that vectors use, in bytes.
#pragma once

#include <cstddef>
#include <vector>

namespace palpate { inline namespace v0 {

template <class... T>
std::size_t bytes_of(const std::vector<T>&... vectors) {
  return (... + (vectors.capacity() * sizeof(T)));
}

}}  // namespace palpate::v0
