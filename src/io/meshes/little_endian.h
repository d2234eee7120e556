// Numbers as the bytes of binary mesh files, the lowest byte first.
#pragma once

#include <algorithm>
#include <array>
#include <bit>
#include <cstring>
#include <string>

namespace palpate { inline namespace v0 {

template <class Number>
void append_little_endian(std::string& to, Number number) {
  auto bytes = std::bit_cast<std::array<char, sizeof(Number)>>(number);
  if constexpr (std::endian::native == std::endian::big) std::ranges::reverse(bytes);
  to.append(bytes.data(), bytes.size());
}

/// Reads the number at `data`, which need not be aligned.
template <class Number>
Number little_endian_at(const char* data) {
  std::array<char, sizeof(Number)> bytes;
  std::memcpy(bytes.data(), data, sizeof(Number));
  if constexpr (std::endian::native == std::endian::big) std::ranges::reverse(bytes);
  return std::bit_cast<Number>(bytes);
}

}}  // namespace palpate::v0
