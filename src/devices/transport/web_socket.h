// The client's end of a WebSocket (RFC 6455) without extensions, and the one HTTP request beside
// it. Written out because libraries for it allocate, start threads or wait without end: here a
// message of a haptic tick is one system call.
#pragma once

#include <cstdint>
#include <string>
#include <string_view>

#include "src/devices/transport/tcp_socket.h"
#include "src/devices/transport/web_socket_frames.h"

namespace palpate { inline namespace v0 {

/// Returns the body of the answer to GET `path`, if its status is 200 and it comes within `timeout`
/// seconds. At most 64 KiB.
Result<std::string> http_get(const NetAddress& address, std::string_view path, double timeout);

class WebSocket {
 public:
  /// Errors: no connection, or the server there speaks no WebSocket.
  static Result<WebSocket> connect(const NetAddress& address, double timeout);

  enum class Got { message, nothing, closed };
  /// The next whole message, waiting for it at most `timeout` seconds. Answers pings. `message` is
  /// valid until the next call. Does not allocate.
  Got receive(std::string_view& message, double timeout) noexcept;
  /// False: the connection is not usable any more. Allocates only while messages grow.
  bool send(std::string_view text, double timeout) noexcept;
  /// Says goodbye and gives the other side 0.1 s to take it.
  void close() noexcept;

 private:
  explicit WebSocket(TcpSocket socket) : socket_(std::move(socket)) {}
  bool send(WebSocketOpcode opcode, std::string_view payload, double timeout) noexcept;

  TcpSocket socket_;
  WebSocketReader reader_;
  std::string frame_;
  std::uint32_t mask_ = 0;
};

}}  // namespace palpate::v0
