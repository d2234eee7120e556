#include "src/devices/vrpn/vrpn_connection.h"

#include <algorithm>
#include <array>
#include <chrono>
#include <utility>

#include "src/core/internal/monotonic_clock.h"

namespace palpate { inline namespace v0 {
namespace {

// Our own numbers for the one sender and the types of what we send.
constexpr std::int32_t kOurSender = 0, kForceFieldType = 0, kPingType = 1;

// Servers number names from zero and give some dozens; a number beyond this is nonsense.
constexpr std::int32_t kMaxNames = 2000;

// The sender of messages about the connection itself.
constexpr std::string_view kControl = "VRPN Control";

// Messages of other devices that one call looks through: it must come to an end in any flood.
constexpr int kMaxForeign = 4096;

constexpr std::array<std::pair<std::string_view, VrpnKind>, 5> kKinds = {{
    {"vrpn_Tracker Pos_Quat", VrpnKind::pose},
    {"vrpn_Tracker Velocity", VrpnKind::velocity},
    {"vrpn_Button Change", VrpnKind::button},
    {"vrpn_Button States", VrpnKind::buttons},
    {"vrpn_ForceDevice Force_Error", VrpnKind::force_error},
}};

}  // namespace

Result<VrpnConnection> VrpnConnection::connect(const NetAddress& address, std::string_view device,
                                               double timeout) {
  const double deadline = monotonic_now() + timeout;
  Result<TcpSocket> socket = TcpSocket::connect(address, timeout);
  if (!socket) return socket.error();
  VrpnConnection connection(std::move(*socket), device);
  connection.out_ = vrpn_cookie();
  VrpnMessage message;
  if (!connection.flush(timeout) ||
      connection.next(message, deadline - monotonic_now()) != VrpnReader::Got::cookie) {
    return Error{Errc::bad_input,
                 describe(address) + " does not answer as a VRPN server of version 7 would"};
  }
  connection.append(kVrpnSenderDescription, kOurSender, vrpn_name(device));
  connection.append(kVrpnTypeDescription, kForceFieldType,
                    vrpn_name("vrpn_ForceDevice Force_Field"));
  connection.append(kVrpnTypeDescription, kPingType, vrpn_name("vrpn_Base ping_message"));
  connection.append(kPingType, kOurSender, "");  // makes it report its buttons
  if (!connection.flush(timeout))
    return Error{Errc::unavailable, describe(address) + " has closed the connection"};
  return connection;
}

VrpnReader::Got VrpnConnection::next(VrpnMessage& message, double timeout) noexcept {
  const double deadline = timeout > 0 ? monotonic_now() + timeout : 0;
  for (;;) {
    const VrpnReader::Got got = reader_.next(message);
    if (got != VrpnReader::Got::nothing) return got;
    std::size_t count = 0;
    const double left = timeout > 0 ? deadline - monotonic_now() : 0;
    switch (socket_.read(reader_.space(), count, left)) {
      case TcpSocket::Got::bytes: reader_.added(count); break;
      case TcpSocket::Got::nothing: return VrpnReader::Got::nothing;
      case TcpSocket::Got::closed: return VrpnReader::Got::broken;
    }
  }
}

VrpnConnection::Got VrpnConnection::receive(VrpnMessage& message, VrpnKind& kind, double timeout) {
  const double deadline = timeout > 0 ? monotonic_now() + timeout : 0;
  for (int i = 0; i < kMaxForeign && !is_closed_; ++i) {
    const double left = timeout > 0 ? deadline - monotonic_now() : 0;
    const VrpnReader::Got got = next(message, left);
    if (got == VrpnReader::Got::nothing) return Got::nothing;
    if (got != VrpnReader::Got::message || message.type == kVrpnDisconnect) {
      is_closed_ = true;
      break;
    }
    if (message.type < 0) {
      learn(message);
    } else if (message.sender == device_id_ && message.type < std::ssize(kinds_)) {
      kind = kinds_[static_cast<std::size_t>(message.type)];
      if (kind != VrpnKind::other) return Got::message;
    }
  }
  return is_closed_ ? Got::closed : Got::nothing;
}

void VrpnConnection::learn(const VrpnMessage& message) {
  std::string_view name;
  const std::int32_t number = message.sender;
  if (number < 0 || number >= kMaxNames || !read_vrpn_name(message.payload, name)) return;
  if (message.type == kVrpnSenderDescription) {
    if (name == device_) device_id_ = number;
    if (name != kControl && senders_.size() < kMaxNames) senders_.emplace_back(name);
  } else if (message.type == kVrpnTypeDescription) {
    const auto known = std::find_if(kKinds.begin(), kKinds.end(),
                                    [name](const auto& each) { return each.first == name; });
    const auto index = static_cast<std::size_t>(number);
    if (kinds_.size() <= index) kinds_.resize(index + 1, VrpnKind::other);
    kinds_[index] = known != kKinds.end() ? known->second : VrpnKind::other;
  }
}

void VrpnConnection::append(std::int32_t type, std::int32_t sender,
                            std::string_view payload) noexcept {
  using std::chrono::microseconds;
  const auto now =
      std::chrono::duration_cast<microseconds>(std::chrono::system_clock::now().time_since_epoch())
          .count();
  append_vrpn_message({static_cast<std::int32_t>(now / 1'000'000),
                       static_cast<std::int32_t>(now % 1'000'000), sender, type, payload},
                      num_sent_++, out_);
}

bool VrpnConnection::flush(double timeout) noexcept {
  const bool is_written = socket_.write(out_, timeout);
  out_.clear();
  return is_written;
}

bool VrpnConnection::send(const VrpnForceField& field) noexcept {
  const std::array<char, 64> payload = vrpn_force_field(field);
  append(kForceFieldType, kOurSender, {payload.data(), payload.size()});
  return flush(0);
}

void VrpnConnection::close() noexcept {
  append(kVrpnDisconnect, kOurSender, "");
  flush(0.05);
  socket_.finish(0.1);
}

}}  // namespace palpate::v0
