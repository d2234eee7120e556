#include "src/devices/haply/json_scanner.h"

#include <charconv>
#include <system_error>

namespace palpate { inline namespace v0 {
namespace {

constexpr int kMaxDepth = 32;

bool is_digit(char c) { return c >= '0' && c <= '9'; }

}  // namespace

bool JsonScanner::fail() noexcept {
  has_failed_ = true;
  next_ = end_;
  return false;
}

char JsonScanner::peek() noexcept {
  while (next_ != end_ && (*next_ == ' ' || *next_ == '\n' || *next_ == '\t' || *next_ == '\r'))
    ++next_;
  return next_ != end_ ? *next_ : '\0';
}

bool JsonScanner::take(char desired) noexcept {
  peek();
  if (next_ == end_ || *next_ != desired) return false;
  ++next_;
  return true;
}

bool JsonScanner::take_word(std::string_view word) noexcept {
  peek();
  if (!std::string_view(next_, static_cast<std::size_t>(end_ - next_)).starts_with(word))
    return false;
  next_ += word.size();
  return true;
}

bool JsonScanner::take_string(std::string_view& text) noexcept {
  if (!take('"')) return false;
  const char* first = next_;
  for (; next_ != end_ && *next_ != '"'; ++next_) {
    if (static_cast<unsigned char>(*next_) < 0x20) return fail();
    if (*next_ == '\\' && ++next_ == end_) break;
  }
  if (next_ == end_) return fail();
  text = {first, static_cast<std::size_t>(next_++ - first)};
  return true;
}

bool JsonScanner::take_number(double& number) noexcept {
  const char first = peek();
  if (first != '-' && !is_digit(first)) return false;
  // from_chars alone would take "-inf" as well.
  if (first == '-' && (end_ - next_ < 2 || !is_digit(next_[1]))) return fail();
  double value = 0;
  const auto [end, error] = std::from_chars(next_, end_, value);
  if (error == std::errc::invalid_argument) return fail();
  next_ = end;
  if (error != std::errc()) return true;  // too large for a double: passed over
  number = value;
  return true;
}

bool JsonScanner::enter(char bracket) noexcept {
  if (peek() != bracket) {
    skip();
    return false;
  }
  ++next_;
  is_at_first_ = true;
  return true;
}

bool JsonScanner::next_in(char closing) noexcept {
  if (has_failed_) return false;
  const bool is_first = is_at_first_;
  is_at_first_ = false;
  if (take(closing)) return false;
  if (!is_first && !take(',')) return fail();
  return true;
}

bool JsonScanner::next_member(std::string_view& key) noexcept {
  if (!next_in('}')) return false;
  if (!take_string(key) || !take(':')) return fail();
  return true;
}

bool JsonScanner::next_element() noexcept { return next_in(']'); }

bool JsonScanner::read(double& number) noexcept {
  const char first = peek();
  if (first == '-' || is_digit(first)) return take_number(number);
  skip();
  return false;
}

bool JsonScanner::read(bool& value) noexcept {
  if (take_word("true")) return value = true;
  if (take_word("false")) {
    value = false;
    return true;
  }
  skip();
  return false;
}

bool JsonScanner::read(std::string_view& text) noexcept {
  if (peek() == '"') return take_string(text);
  skip();
  return false;
}

void JsonScanner::skip_value(int depth) noexcept {
  std::string_view text;
  double number = 0;
  const char first = peek();
  if (first == '{' || first == '[') {
    if (depth == kMaxDepth) {
      fail();
      return;
    }
    ++next_;
    is_at_first_ = true;
    while (first == '{' ? next_member(text) : next_element()) skip_value(depth + 1);
  } else if (!take_string(text) && !take_number(number) && !take_word("true") &&
             !take_word("false") && !take_word("null")) {
    fail();
  }
}

bool JsonScanner::is_complete() noexcept {
  peek();
  return !has_failed_ && next_ == end_;
}

}}  // namespace palpate::v0
