// A TCP connection with a limit on every wait.
#pragma once

#include <cstddef>
#include <optional>
#include <span>
#include <string>
#include <string_view>

#include "palpate/core/core.h"

namespace palpate { inline namespace v0 {

/// HOST, HOST:PORT, [IPV6] or [IPV6]:PORT.
struct NetAddress {
  std::string host;
  int port = 0;
};
/// Parses an address; empty if the text is none. `default_port` is used where it names no port.
std::optional<NetAddress> parse_net_address(std::string_view text, int default_port);
std::string describe(const NetAddress& address);  ///< HOST:PORT

/// Moves, does not copy. Small messages leave at once (TCP_NODELAY). No call of a connected socket
/// allocates, throws or raises a signal.
class TcpSocket {
 public:
  TcpSocket() = default;
  ~TcpSocket() { close(); }
  TcpSocket(TcpSocket&& other) noexcept;
  TcpSocket& operator=(TcpSocket&& other) noexcept;

  /// Tries every address of the host, for `timeout` seconds in all (looking up a name that is not
  /// local may take the resolver's own time). Errors: those of the system, about HOST:PORT.
  static Result<TcpSocket> connect(const NetAddress& address, double timeout);

  enum class Got { bytes, nothing, closed };
  /// Waits at most `timeout` seconds for bytes; `count` is how many came.
  Got read(std::span<char> buffer, std::size_t& count, double timeout) noexcept;
  /// Sends all bytes within `timeout` seconds. False: the connection is not usable any more.
  bool write(std::string_view bytes, double timeout) noexcept;
  /// Closes once the other side has closed too, or after `timeout` seconds. To close with bytes
  /// unread would make the system throw away what the other side has not read yet, such as a last
  /// zero force.
  void finish(double timeout) noexcept;
  void close() noexcept;
  bool is_open() const noexcept { return descriptor_ >= 0; }

 private:
  explicit TcpSocket(int descriptor) : descriptor_(descriptor) {}

  int descriptor_ = -1;
};

}}  // namespace palpate::v0
