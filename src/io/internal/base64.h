// Bytes as text (RFC 4648).
#pragma once

#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <string_view>

namespace palpate { inline namespace v0 {

/// Returns the bytes in base64, padded with '='.
std::string base64(std::string_view bytes);

inline std::string base64(std::span<const std::uint8_t> bytes) {
  return base64(std::string_view(reinterpret_cast<const char*>(bytes.data()), bytes.size()));
}

/// Returns the bytes of a text in base64, with or without its padding; none if it is no such text.
std::optional<std::string> bytes_of_base64(std::string_view text);

}}  // namespace palpate::v0
