#include "src/devices/transport/web_socket_frames.h"

#include <algorithm>
#include <cstring>

namespace palpate { inline namespace v0 {
namespace {

constexpr std::uint8_t kFinal = 0x80, kReserved = 0x70, kOpcode = 0x0f, kMasked = 0x80;
constexpr std::size_t kMaxControl = 125;  // bytes of a ping, pong or close

/// Unsigned, most significant byte first.
std::uint64_t read_big_endian(const char* bytes, std::size_t count) {
  std::uint64_t value = 0;
  for (std::size_t i = 0; i < count; ++i) value = value << 8 | static_cast<std::uint8_t>(bytes[i]);
  return value;
}

}  // namespace

void write_web_socket_frame(WebSocketOpcode opcode, std::string_view payload, std::uint32_t mask,
                            std::string& frame) {
  const auto put = [&](std::uint64_t value, int num_bytes) {
    for (int shift = 8 * (num_bytes - 1); shift >= 0; shift -= 8)
      frame.push_back(static_cast<char>(value >> shift));
  };
  frame.clear();
  put(kFinal | static_cast<std::uint8_t>(opcode), 1);
  if (payload.size() < 126) {
    put(kMasked | payload.size(), 1);
  } else if (payload.size() < 65536) {
    put(kMasked | 126u, 1);
    put(payload.size(), 2);
  } else {
    put(kMasked | 127u, 1);
    put(payload.size(), 8);
  }
  put(mask, 4);
  for (std::size_t i = 0; i < payload.size(); ++i)
    frame.push_back(static_cast<char>(payload[i] ^ static_cast<char>(mask >> (24 - 8 * (i % 4)))));
}

std::span<char> WebSocketReader::space() noexcept {
  if (begin_ > 0) {
    std::memmove(bytes_.data(), bytes_.data() + begin_, end_ - begin_);
    end_ -= begin_;
    begin_ = 0;
  }
  return {bytes_.data() + end_, bytes_.size() - end_};
}

WebSocketReader::Got WebSocketReader::next(std::string_view& payload) noexcept {
  while (!is_broken_) {
    const char* head = bytes_.data() + begin_;
    const std::size_t available = end_ - begin_;
    if (available < 2) return Got::nothing;
    const auto first_byte = static_cast<std::uint8_t>(head[0]);
    const auto second_byte = static_cast<std::uint8_t>(head[1]);
    std::uint64_t length = second_byte & ~kMasked;
    const std::size_t num_length_bytes = length == 127 ? 8 : (length == 126 ? 2 : 0);
    if (available < 2 + num_length_bytes) return Got::nothing;
    if (num_length_bytes > 0) length = read_big_endian(head + 2, num_length_bytes);
    // A server does not mask, and no extension has been agreed on.
    if ((second_byte & kMasked) || (first_byte & kReserved) || length > kMaxMessage) break;
    const std::size_t size = 2 + num_length_bytes + length;
    if (available < size) return Got::nothing;
    begin_ += size;
    const Got got = take_frame(first_byte, {head + 2 + num_length_bytes, length}, payload);
    if (got != Got::nothing) return got;
  }
  is_broken_ = true;
  return Got::broken;
}

WebSocketReader::Got WebSocketReader::take_frame(std::uint8_t first_byte, std::string_view payload,
                                                 std::string_view& message) noexcept {
  const bool is_final = first_byte & kFinal;
  const auto opcode = static_cast<WebSocketOpcode>(first_byte & kOpcode);
  message = payload;
  switch (opcode) {
    case WebSocketOpcode::text:
    case WebSocketOpcode::binary:
      if (is_in_message_) break;
      if (is_final) return Got::message;
      message_size_ = 0;
      is_in_message_ = true;
      [[fallthrough]];
    case WebSocketOpcode::continuation:
      if (!is_in_message_ || message_size_ + payload.size() > kMaxMessage) break;
      std::copy(payload.begin(), payload.end(), message_.data() + message_size_);
      message_size_ += payload.size();
      if (!is_final) return Got::nothing;
      is_in_message_ = false;
      message = {message_.data(), message_size_};
      return Got::message;
    case WebSocketOpcode::close:
    case WebSocketOpcode::ping:
    case WebSocketOpcode::pong:
      if (!is_final || payload.size() > kMaxControl) break;
      if (opcode == WebSocketOpcode::close) return Got::close;
      return opcode == WebSocketOpcode::ping ? Got::ping : Got::nothing;
  }
  is_broken_ = true;
  return Got::broken;
}

}}  // namespace palpate::v0
