// The bytes of MCAP files: records of an operation code, a length and contents; all numbers little
// endian (https://mcap.dev/spec).
#pragma once

#include <cstdint>
#include <cstring>
#include <string>
#include <string_view>

namespace palpate { inline namespace v0 { namespace mcap {

inline constexpr std::string_view kMagic{"\x89MCAP0\r\n", 8};

inline constexpr std::string_view kZstd = "zstd", kLz4 = "lz4";  // how chunks are compressed

enum class Op : std::uint8_t {
  header = 0x01,
  footer = 0x02,
  schema = 0x03,
  channel = 0x04,
  message = 0x05,
  chunk = 0x06,
  message_index = 0x07,
  chunk_index = 0x08,
  attachment = 0x09,
  attachment_index = 0x0a,
  statistics = 0x0b,
  data_end = 0x0f,
};

/// Appends numbers and texts to a buffer.
class Bytes {
 public:
  template <class Int>
  Bytes& number(Int value) {
    for (std::size_t i = 0; i < sizeof(Int); ++i) {
      text_.push_back(static_cast<char>(static_cast<std::uint64_t>(value) >> (8 * i)));
    }
    return *this;
  }
  Bytes& raw(std::string_view bytes) {
    text_.append(bytes);
    return *this;
  }
  /// Length in 32 bits, then the text.
  Bytes& text(std::string_view value) {
    return number(static_cast<std::uint32_t>(value.size())).raw(value);
  }
  /// Appends a whole record, or nothing if memory is exhausted.
  Bytes& record(Op op, std::string_view contents) {
    make_room(9 + contents.size());
    return number(static_cast<std::uint8_t>(op))
        .number(static_cast<std::uint64_t>(contents.size()))
        .raw(contents);
  }

  /// Reserves memory for so many bytes to be added next.
  void make_room(std::size_t num_bytes) { text_.reserve(text_.size() + num_bytes); }

  const std::string& str() const { return text_; }
  std::size_t size() const { return text_.size(); }
  bool empty() const { return text_.empty(); }
  void clear() { text_.clear(); }

 private:
  std::string text_;
};

/// Reads them back. Past the end everything is 0 and `is_good` false.
class Cursor {
 public:
  explicit Cursor(std::string_view bytes) : rest_(bytes) {}

  template <class Int>
  Int number() {
    const std::string_view bytes = raw(sizeof(Int));
    std::uint64_t value = 0;
    for (std::size_t i = 0; i < bytes.size(); ++i) {
      value |= std::uint64_t{static_cast<unsigned char>(bytes[i])} << (8 * i);
    }
    return static_cast<Int>(value);
  }
  std::string_view raw(std::uint64_t size) {
    if (size > rest_.size()) {
      is_good_ = false;
      rest_ = {};
      return {};
    }
    const std::string_view bytes = rest_.substr(0, static_cast<std::size_t>(size));
    rest_.remove_prefix(static_cast<std::size_t>(size));
    return bytes;
  }
  std::string_view text() { return raw(number<std::uint32_t>()); }

  bool is_good() const { return is_good_; }
  bool at_end() const { return rest_.empty(); }

 private:
  std::string_view rest_;
  bool is_good_ = true;
};

}}}  // namespace palpate::v0::mcap
