// Common Data Representation (XCDR1, little-endian): how ROS 2 puts messages into bytes.
#pragma once

#include <algorithm>
#include <bit>
#include <cstdint>
#include <cstring>
#include <string>
#include <string_view>
#include <type_traits>

namespace palpate { inline namespace v0 {

static_assert(std::endian::native == std::endian::little, "messages are little-endian");

/// Numbers are aligned to their size, from the end of the header on.
class CdrWriter {
 public:
  template <class Number>
  void number(Number value) {
    static_assert(std::is_arithmetic_v<Number> || std::is_enum_v<Number>);
    align(sizeof value);
    bytes_.append(reinterpret_cast<const char*>(&value), sizeof value);
  }
  void text(std::string_view text) {
    number(static_cast<std::uint32_t>(text.size() + 1));
    bytes_.append(text);
    bytes_ += '\0';
  }
  /// A sequence of bytes.
  void bytes(const void* data, std::size_t size) {
    number(static_cast<std::uint32_t>(size));
    if (size > 0) bytes_.append(static_cast<const char*>(data), size);
  }
  std::string take() { return std::move(bytes_); }

 private:
  static constexpr std::size_t kHeader = 4;
  void align(std::size_t size) {
    const std::size_t rest = (bytes_.size() - kHeader) % size;
    if (rest > 0) bytes_.append(size - rest, '\0');
  }
  std::string bytes_{"\x00\x01\x00\x00", kHeader};
};

/// Past the end everything is 0 and `is_good` false.
class CdrReader {
 public:
  explicit CdrReader(std::string_view message) : bytes_(message), at_(kHeader) {
    is_good_ = message.size() >= kHeader && message[0] == 0 && message[1] == 1;
  }

  template <class Number>
  Number number() {
    at_ += (sizeof(Number) - (at_ - kHeader) % sizeof(Number)) % sizeof(Number);
    Number value{};
    const std::string_view raw = take(sizeof value);
    if (raw.size() == sizeof value) std::memcpy(&value, raw.data(), sizeof value);
    return value;
  }
  std::string_view text() {
    const std::string_view text = take(number<std::uint32_t>());
    return text.substr(0, text.empty() ? 0 : text.size() - 1);
  }
  std::string_view bytes() { return take(number<std::uint32_t>()); }
  bool is_good() const { return is_good_; }
  std::size_t num_left() const { return at_ < bytes_.size() ? bytes_.size() - at_ : 0; }

 private:
  static constexpr std::size_t kHeader = 4;
  std::string_view take(std::size_t size) {
    is_good_ = is_good_ && at_ <= bytes_.size() && size <= bytes_.size() - at_;
    if (!is_good_) return {};
    const std::string_view taken = bytes_.substr(at_, size);
    at_ += size;
    return taken;
  }
  std::string_view bytes_;
  std::size_t at_;
  bool is_good_ = true;
};

}}  // namespace palpate::v0
