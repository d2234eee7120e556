#include "src/devices/vrpn/vrpn_wire.h"

#include <algorithm>
#include <bit>
#include <cstring>

namespace palpate { inline namespace v0 {
namespace {

constexpr std::size_t kCookieSize = 24, kHeaderSize = 24;
constexpr std::string_view kCookie = "vrpn: ver. 07.38  0";
constexpr std::size_t kMaxButtons = 32;  // that we know; VRPN's are up to 256

constexpr std::size_t padded(std::size_t size) { return (size + 7) / 8 * 8; }

/// Takes numbers from the front of bytes; zeros after the end.
class Numbers {
 public:
  explicit Numbers(std::string_view bytes) : rest_(bytes) {}

  std::int32_t int32() { return static_cast<std::int32_t>(bits(4)); }
  double float64() { return std::bit_cast<double>(bits(8)); }
  Vec3d vector() {
    const double x = float64(), y = float64(), z = float64();
    return {x, y, z};
  }
  Quaternion quaternion() {
    const double x = float64(), y = float64(), z = float64(), w = float64();
    return {x, y, z, w};
  }

 private:
  std::uint64_t bits(std::size_t num_bytes) {
    std::uint64_t value = 0;
    for (std::size_t i = 0; i < std::min(num_bytes, rest_.size()); ++i)
      value = value << 8 | static_cast<std::uint8_t>(rest_[i]);
    rest_.remove_prefix(std::min(num_bytes, rest_.size()));
    return value;
  }

  std::string_view rest_;
};

void put(std::uint32_t value, char* bytes) {
  for (int i = 0; i < 4; ++i) bytes[i] = static_cast<char>(value >> (24 - 8 * i));
}

void append(std::int32_t value, std::string& bytes) {
  std::array<char, 4> four;
  put(static_cast<std::uint32_t>(value), four.data());
  bytes.append(four.data(), four.size());
}

}  // namespace

std::string vrpn_cookie() {
  std::string cookie(kCookie);
  cookie.resize(kCookieSize);
  return cookie;
}

bool is_vrpn_cookie(std::string_view cookie) {
  return cookie.starts_with(kCookie.substr(0, kCookie.rfind('.')));
}

void append_vrpn_message(const VrpnMessage& message, std::int32_t sequence_number,
                         std::string& bytes) {
  append(static_cast<std::int32_t>(kHeaderSize + message.payload.size()), bytes);
  append(message.seconds, bytes);
  append(message.microseconds, bytes);
  append(message.sender, bytes);
  append(message.type, bytes);
  append(sequence_number, bytes);
  bytes += message.payload;
  bytes.append(padded(message.payload.size()) - message.payload.size(), '\0');
}

std::span<char> VrpnReader::space() noexcept {
  if (begin_ > 0) {
    std::memmove(bytes_.data(), bytes_.data() + begin_, end_ - begin_);
    end_ -= begin_;
    begin_ = 0;
  }
  return {bytes_.data() + end_, bytes_.size() - end_};
}

VrpnReader::Got VrpnReader::next(VrpnMessage& message) noexcept {
  if (is_broken_) return Got::broken;
  const std::string_view unread(bytes_.data() + begin_, end_ - begin_);
  static_assert(kCookieSize == kHeaderSize);
  if (unread.size() < kHeaderSize) return Got::nothing;
  if (!has_cookie_) {
    has_cookie_ = is_vrpn_cookie(unread);
    is_broken_ = !has_cookie_;
    begin_ += kCookieSize;
    return has_cookie_ ? Got::cookie : Got::broken;
  }
  Numbers header(unread);
  const std::int32_t length = header.int32();  // without padding
  if (length < static_cast<std::int32_t>(kHeaderSize) ||
      length > static_cast<std::int32_t>(kHeaderSize + kMaxPayload)) {
    is_broken_ = true;
    return Got::broken;
  }
  const std::size_t payload_size = static_cast<std::size_t>(length) - kHeaderSize;
  const std::size_t size = kHeaderSize + padded(payload_size);
  if (unread.size() < size) return Got::nothing;
  message.seconds = header.int32();
  message.microseconds = header.int32();
  message.sender = header.int32();
  message.type = header.int32();
  message.payload = unread.substr(kHeaderSize, payload_size);
  begin_ += size;
  return Got::message;
}

bool read_vrpn_name(std::string_view payload, std::string_view& name) noexcept {
  if (payload.size() < 5) return false;
  const std::int32_t length = Numbers(payload).int32();  // with the zero at its end
  if (length < 1 || static_cast<std::size_t>(length) > payload.size() - 4) return false;
  name = payload.substr(4, static_cast<std::size_t>(length));
  name = name.substr(0, name.find('\0'));
  return true;
}

std::string vrpn_name(std::string_view name) {
  std::string payload;
  append(static_cast<std::int32_t>(name.size() + 1), payload);
  payload += name;
  payload.push_back('\0');
  return payload;
}

bool read_vrpn_pose(std::string_view payload, VrpnPose& pose) noexcept {
  if (payload.size() != 64) return false;
  Numbers numbers(payload);
  pose.sensor = numbers.int32();
  numbers.int32();  // padding
  pose.X_BH.translation = numbers.vector();
  pose.X_BH.rotation = numbers.quaternion();
  return true;
}

bool read_vrpn_velocity(std::string_view payload, VrpnVelocity& velocity) noexcept {
  if (payload.size() != 72) return false;
  Numbers numbers(payload);
  velocity.sensor = numbers.int32();
  numbers.int32();  // padding
  velocity.linear = numbers.vector();
  velocity.turn = numbers.quaternion();
  velocity.interval = numbers.float64();
  return true;
}

bool read_vrpn_button(std::string_view payload, std::int32_t& button, bool& is_down) noexcept {
  if (payload.size() != 8) return false;
  Numbers numbers(payload);
  button = numbers.int32();
  is_down = numbers.int32() != 0;
  return button >= 0 && button < static_cast<std::int32_t>(kMaxButtons);
}

bool read_vrpn_buttons(std::string_view payload, std::uint32_t& buttons) noexcept {
  if (payload.size() < 4 || payload.size() % 4 != 0) return false;
  Numbers numbers(payload);
  const std::int32_t count = numbers.int32();
  if (count < 0 || static_cast<std::size_t>(count) > payload.size() / 4 - 1) return false;
  buttons = 0;
  for (std::size_t i = 0; i < std::min(static_cast<std::size_t>(count), kMaxButtons); ++i)
    buttons |= (numbers.int32() != 0 ? 1u : 0u) << i;
  return true;
}

bool read_vrpn_force_error(std::string_view payload, std::int32_t& code) noexcept {
  if (payload.size() != 4) return false;
  code = Numbers(payload).int32();
  return true;
}

std::array<char, 64> vrpn_force_field(const VrpnForceField& field) noexcept {
  std::array<char, 64> payload;
  char* next = payload.data();
  const auto add = [&next](double number) {
    put(std::bit_cast<std::uint32_t>(static_cast<float>(number)), next);
    next += 4;
  };
  for (int i = 0; i < 3; ++i) add(field.origin[i]);
  for (int i = 0; i < 3; ++i) add(field.force[i]);
  for (const auto& row : field.jacobian.m)
    for (double number : row) add(number);
  add(field.radius);
  return payload;
}

}}  // namespace palpate::v0
