// Numbers and names as messages have them.
#pragma once

#include <cstdio>
#include <string>
#include <string_view>

namespace palpate { inline namespace v0 {

/// With so many significant digits.
inline std::string number_text(double value, int digits = 3) {
  char text[32];
  std::snprintf(text, sizeof text, "%.*g", digits, value);
  return text;
}

/// Its first characters: a file may have megabytes of it, and a message comes with every frame.
inline std::string shown(std::string_view name) {
  constexpr std::size_t kMaxCharacters = 60;
  return std::string(name.substr(0, kMaxCharacters));
}

}}  // namespace palpate::v0
