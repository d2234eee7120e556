// Numbers as messages give them.
#pragma once

#include <cstdio>
#include <string>

namespace palpate { inline namespace v0 {

/// With so many significant digits.
inline std::string number_text(double value, int digits = 3) {
  char text[32];
  std::snprintf(text, sizeof text, "%.*g", digits, value);
  return text;
}

}}  // namespace palpate::v0
