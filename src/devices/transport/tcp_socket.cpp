#include "src/devices/transport/tcp_socket.h"

#include <fcntl.h>
#include <netdb.h>
#include <netinet/in.h>
#include <netinet/tcp.h>
#include <poll.h>
#include <sys/socket.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <charconv>
#include <cmath>
#include <memory>
#include <system_error>
#include <utility>

#include "src/core/internal/monotonic_clock.h"

namespace palpate { inline namespace v0 {
namespace {

/// True if the socket is ready for `events`, or broken, before `deadline` (s, monotonic).
bool wait_for(int descriptor, short events, double deadline) noexcept {
  for (;;) {
    const double left = std::clamp(deadline - monotonic_now(), 0.0, 60.0);
    pollfd requested{descriptor, events, 0};
    const int answer = ::poll(&requested, 1, static_cast<int>(std::ceil(left * 1e3)));
    if (answer >= 0) return answer > 0;
    if (errno != EINTR) return true;
  }
}

/// The error number of connecting to one address; 0: connected.
int connect_before(int descriptor, const addrinfo& address, double deadline) noexcept {
  if (::connect(descriptor, address.ai_addr, address.ai_addrlen) == 0) return 0;
  if (errno != EINPROGRESS) return errno;
  if (!wait_for(descriptor, POLLOUT, deadline)) return ETIMEDOUT;
  int error = 0;
  socklen_t size = sizeof error;
  if (::getsockopt(descriptor, SOL_SOCKET, SO_ERROR, &error, &size) != 0) return errno;
  return error;
}

}  // namespace

std::optional<NetAddress> parse_net_address(std::string_view text, int default_port) {
  NetAddress address{"", default_port};
  std::string_view port;
  if (text.starts_with('[')) {
    const std::size_t end = text.find(']');
    if (end == std::string_view::npos) return std::nullopt;
    address.host = text.substr(1, end - 1);
    text.remove_prefix(end + 1);
    if (!text.empty() && text.front() != ':') return std::nullopt;
  } else {
    const std::size_t end = std::min(text.find(':'), text.size());
    address.host = text.substr(0, end);
    text.remove_prefix(end);
  }
  if (address.host.empty()) return std::nullopt;
  if (text.empty()) return address;
  port = text.substr(1);
  const auto [end, error] = std::from_chars(port.data(), port.data() + port.size(), address.port);
  if (error != std::errc() || end != port.data() + port.size()) return std::nullopt;
  if (address.port < 1 || address.port > 65535) return std::nullopt;
  return address;
}

std::string describe(const NetAddress& address) {
  const bool is_ipv6 = address.host.find(':') != std::string::npos;
  return (is_ipv6 ? '[' + address.host + ']' : address.host) + ':' + std::to_string(address.port);
}

TcpSocket::TcpSocket(TcpSocket&& other) noexcept
    : descriptor_(std::exchange(other.descriptor_, -1)) {}

TcpSocket& TcpSocket::operator=(TcpSocket&& other) noexcept {
  std::swap(descriptor_, other.descriptor_);
  return *this;
}

Result<TcpSocket> TcpSocket::connect(const NetAddress& address, double timeout) {
  const double deadline = monotonic_now() + timeout;
  addrinfo desired{};
  desired.ai_socktype = SOCK_STREAM;
  addrinfo* found = nullptr;
  if (const int error = ::getaddrinfo(address.host.c_str(), std::to_string(address.port).c_str(),
                                      &desired, &found)) {
    return Error{Errc::not_found, describe(address) + ": " + ::gai_strerror(error)};
  }
  const std::unique_ptr<addrinfo, void (*)(addrinfo*)> addresses(found, ::freeaddrinfo);
  int error = ETIMEDOUT;
  for (const addrinfo* each = found; each != nullptr; each = each->ai_next) {
    TcpSocket socket(::socket(each->ai_family, each->ai_socktype | SOCK_NONBLOCK | SOCK_CLOEXEC,
                              each->ai_protocol));
    error = socket.is_open() ? connect_before(socket.descriptor_, *each, deadline) : errno;
    if (error != 0) continue;
    const int on = 1;
    ::setsockopt(socket.descriptor_, IPPROTO_TCP, TCP_NODELAY, &on, sizeof on);
    return socket;
  }
  return Error{Errc::unavailable,
               describe(address) + ": " + std::generic_category().message(error)};
}

TcpSocket::Got TcpSocket::read(std::span<char> buffer, std::size_t& count,
                               double timeout) noexcept {
  count = 0;
  if (!is_open()) return Got::closed;
  const double deadline = timeout > 0 ? monotonic_now() + timeout : 0;
  for (;;) {
    const ssize_t got = ::recv(descriptor_, buffer.data(), buffer.size(), 0);
    if (got > 0) {
      count = static_cast<std::size_t>(got);
      return Got::bytes;
    }
    if (got == 0) return Got::closed;
    if (errno == EINTR) continue;
    if (errno != EAGAIN && errno != EWOULDBLOCK) return Got::closed;
    if (!(timeout > 0) || !wait_for(descriptor_, POLLIN, deadline)) return Got::nothing;
  }
}

bool TcpSocket::write(std::string_view bytes, double timeout) noexcept {
  if (!is_open()) return false;
  const double deadline = timeout > 0 ? monotonic_now() + timeout : 0;
  while (!bytes.empty()) {
    const ssize_t sent = ::send(descriptor_, bytes.data(), bytes.size(), MSG_NOSIGNAL);
    if (sent >= 0) {
      bytes.remove_prefix(static_cast<std::size_t>(sent));
    } else if (errno == EAGAIN || errno == EWOULDBLOCK) {
      if (!(timeout > 0) || !wait_for(descriptor_, POLLOUT, deadline)) return false;
    } else if (errno != EINTR) {
      return false;
    }
  }
  return true;
}

void TcpSocket::finish(double timeout) noexcept {
  if (!is_open()) return;
  ::shutdown(descriptor_, SHUT_WR);
  const double deadline = monotonic_now() + timeout;
  std::array<char, 4096> ignored;
  std::size_t count = 0;
  double left = timeout;
  while (left > 0 && read(ignored, count, left) == Got::bytes) left = deadline - monotonic_now();
  close();
}

void TcpSocket::close() noexcept {
  if (is_open()) ::close(std::exchange(descriptor_, -1));
}

}}  // namespace palpate::v0
