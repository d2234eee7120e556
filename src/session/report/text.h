// Numbers as the shortest decimals that read back to the same bits.
#pragma once

#include <charconv>
#include <string>

namespace palpate { inline namespace v0 {

template <class Number>
void append_number(std::string& text, Number value) {
  char buffer[32];
  text.append(buffer, std::to_chars(buffer, buffer + sizeof buffer, value).ptr);
}

/// Appends the values with `separator` between them, then a newline.
template <class First, class... Rest>
void append_row(std::string& text, char separator, First first, Rest... rest) {
  append_number(text, first);
  ((text += separator, append_number(text, rest)), ...);
  text += '\n';
}

}}  // namespace palpate::v0
