// The frames of WebSockets (RFC 6455, section 5) as a client sends and receives them.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <string>
#include <string_view>
#include <vector>

namespace palpate { inline namespace v0 {

enum class WebSocketOpcode : std::uint8_t {
  continuation = 0,
  text = 1,
  binary = 2,
  close = 8,
  ping = 9,
  pong = 10,
};

/// Replaces `frame` by one masked frame.
void write_web_socket_frame(WebSocketOpcode opcode, std::string_view payload, std::uint32_t mask,
                            std::string& frame);

/// Puts messages together again from bytes as they come. Allocates at construction only.
class WebSocketReader {
 public:
  /// More in one message than this is taken for an error.
  static constexpr std::size_t kMaxMessage = 256 * 1024;

  WebSocketReader() : bytes_(kMaxMessage + 16), message_(kMaxMessage) {}

  /// Free space for received bytes, and how many were written there. Never empty after `nothing`.
  std::span<char> space() noexcept;
  void added(std::size_t count) noexcept { end_ += count; }

  enum class Got { nothing, message, ping, close, broken };
  /// `payload` is valid until the next call of anything here. Pongs are swallowed. Once broken, it
  /// stays broken.
  Got next(std::string_view& payload) noexcept;

 private:
  Got take_frame(std::uint8_t first_byte, std::string_view payload,
                 std::string_view& message) noexcept;

  std::vector<char> bytes_, message_;
  std::size_t begin_ = 0, end_ = 0;  // unread part of bytes_
  std::size_t message_size_ = 0;     // of a message in several frames
  bool is_in_message_ = false, is_broken_ = false;
};

}}  // namespace palpate::v0
