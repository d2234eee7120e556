// JSON read from front to back, without a tree and without allocating: for messages at every tick.
#pragma once

#include <cstddef>
#include <string_view>

namespace palpate { inline namespace v0 {

/// A reader says what it expects; a value of another kind is passed over and counts as absent, bad
/// JSON ends everything. `for (JsonScanner json(text); ...)`: see
/// src/devices/haply/haply_messages.cpp.
class JsonScanner {
 public:
  explicit JsonScanner(std::string_view text) : next_(text.data()), end_(next_ + text.size()) {}

  /// Steps into the object or array that comes next; false: there is none, the value is passed
  /// over.
  bool enter_object() noexcept { return enter('{'); }
  bool enter_array() noexcept { return enter('['); }
  /// The next member or element, of which the value must be read or passed over next; false: there
  /// are no more, and we are out of it. Keys and strings come as written, escapes and all.
  bool next_member(std::string_view& key) noexcept;
  bool next_element() noexcept;

  /// True if the value is what the argument can hold, which is then set.
  bool read(double& number) noexcept;
  bool read(bool& value) noexcept;
  bool read(std::string_view& text) noexcept;
  void skip() noexcept { skip_value(0); }

  /// All of the text has been read and was JSON as far as can be said.
  bool is_complete() noexcept;

 private:
  bool enter(char bracket) noexcept;
  bool next_in(char closing) noexcept;
  char peek() noexcept;  // the next character after blanks; 0: none
  bool take(char desired) noexcept;
  bool take_word(std::string_view word) noexcept;
  bool take_string(std::string_view& text) noexcept;
  bool take_number(double& number) noexcept;
  void skip_value(int depth) noexcept;
  bool fail() noexcept;

  const char* next_;
  const char* end_;
  bool has_failed_ = false;
  bool is_at_first_ = false;  // just inside a bracket
};

}}  // namespace palpate::v0
