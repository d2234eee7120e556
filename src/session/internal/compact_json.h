// Numbers and bytes of pages, as short as what they show allows.
#pragma once

#include <charconv>
#include <cmath>
#include <nlohmann/json.hpp>
#include <span>
#include <string>

#include "src/io/internal/base64.h"

namespace palpate { inline namespace v0 {

/// With so many significant digits; null if it is not finite.
inline nlohmann::ordered_json compact(double value, int digits = 5) {
  if (!std::isfinite(value)) return nullptr;
  char text[40];
  const auto end =
      std::to_chars(text, text + sizeof text, value, std::chars_format::scientific, digits - 1).ptr;
  double rounded = 0;
  std::from_chars(text, end, rounded);
  return rounded;
}

/// The values as they lie in memory, which is little-endian, in base64.
template <class Value>
std::string packed(std::span<const Value> values) {
  return base64(
      std::string_view(reinterpret_cast<const char*>(values.data()), values.size_bytes()));
}

/// On one line, for a page.
inline std::string page_text(const nlohmann::ordered_json& json) {
  return json.dump(-1, ' ', false, nlohmann::ordered_json::error_handler_t::replace);
}

}}  // namespace palpate::v0
