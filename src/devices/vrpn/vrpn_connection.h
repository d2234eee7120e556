// A connection to a VRPN server, seen by one of its devices.
#pragma once

#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

#include "src/devices/transport/tcp_socket.h"
#include "src/devices/vrpn/vrpn_wire.h"

namespace palpate { inline namespace v0 {

/// The messages of a device that we understand, and one that we send.
enum class VrpnKind { other, pose, velocity, button, buttons, force_error };

/// TCP only: a server that was given no UDP port sends everything this way.
class VrpnConnection {
 public:
  /// Exchanges cookies with the server, then subscribes to what the device named `device` reports.
  /// Errors: no server, another version.
  static Result<VrpnConnection> connect(const NetAddress& address, std::string_view device,
                                        double timeout);

  enum class Got { message, nothing, closed };
  /// The next message that the device has sent, waiting for it at most `timeout` seconds; valid
  /// until the next call. Allocates only while the server gives new names.
  Got receive(VrpnMessage& message, VrpnKind& kind, double timeout);
  /// False: the connection is not usable any more.
  bool send(const VrpnForceField& field) noexcept;
  /// Says goodbye and gives the server 0.1 s to take it.
  void close() noexcept;

  bool knows_device() const { return device_id_ >= 0; }
  const std::vector<std::string>& senders() const { return senders_; }  ///< that the server named

 private:
  VrpnConnection(TcpSocket socket, std::string_view device)
      : socket_(std::move(socket)), device_(device) {}
  void append(std::int32_t type, std::int32_t sender, std::string_view payload) noexcept;
  bool flush(double timeout) noexcept;
  void learn(const VrpnMessage& message);
  VrpnReader::Got next(VrpnMessage& message, double timeout) noexcept;

  TcpSocket socket_;
  VrpnReader reader_;
  std::string device_, out_;
  std::vector<std::string> senders_;
  std::vector<VrpnKind> kinds_;  // by the server's number of the type
  std::int32_t device_id_ = -1, num_sent_ = 0;
  bool is_closed_ = false;
};

}}  // namespace palpate::v0
