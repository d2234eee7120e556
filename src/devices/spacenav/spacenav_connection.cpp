#include "src/devices/spacenav/spacenav_connection.h"

#include <sys/socket.h>
#include <sys/un.h>
#include <unistd.h>

#include <cerrno>
#include <cstdlib>
#include <cstring>
#include <system_error>

namespace palpate { inline namespace v0 {
namespace {

constexpr int kMaxUnknown = 16;

Error not_there(const std::string& path, const std::string& why) {
  return {Errc::not_found, "no spacenavd at " + path + ": " + why +
                               "; install and start it (package spacenavd), plug the mouse in, or "
                               "give spacenav:SOCKET"};
}

}  // namespace

SpacenavConnection::~SpacenavConnection() {
  if (is_open()) ::close(socket_);
}

Result<SpacenavConnection> SpacenavConnection::open(const std::string& path) {
  sockaddr_un address{};
  address.sun_family = AF_UNIX;
  if (path.empty() || path.size() >= sizeof address.sun_path)
    return not_there(path, "a socket's path has 1 to " +
                               std::to_string(sizeof address.sun_path - 1) + " letters");
  std::memcpy(address.sun_path, path.data(), path.size());
  SpacenavConnection connection;
  connection.socket_ = ::socket(AF_UNIX, SOCK_STREAM | SOCK_NONBLOCK | SOCK_CLOEXEC, 0);
  if (!connection.is_open() ||
      ::connect(connection.socket_, reinterpret_cast<const sockaddr*>(&address), sizeof address) !=
          0)
    return not_there(path, std::generic_category().message(errno));
  return connection;
}

SpacenavConnection::Answer SpacenavConnection::next(Event& event) noexcept {
  while (true) {
    const ssize_t num = ::recv(socket_, received_.data() + num_received_,
                               received_.size() - num_received_, MSG_DONTWAIT);
    if (num < 0 && errno == EINTR) continue;
    if (num < 0) {
      const bool is_silence = errno == EAGAIN || errno == EWOULDBLOCK;
      return is_silence ? Answer::nothing_yet : Answer::closed;
    }
    if (num == 0) return Answer::closed;
    num_received_ += static_cast<std::size_t>(num);
    if (num_received_ < received_.size()) continue;
    num_received_ = 0;
    std::memcpy(event.data(), received_.data(), received_.size());
    if (event[0] >= kMotion && event[0] <= kRelease) {
      num_unknown_ = 0;
      return Answer::event;
    }
    if (++num_unknown_ >= kMaxUnknown) return Answer::not_understood;
  }
}

std::string spacenav_socket_path(std::string_view given) {
  if (!given.empty()) return std::string(given);
  const char* named = std::getenv("SPNAV_SOCKET");
  return named != nullptr && *named != '\0' ? named : "/var/run/spnav.sock";
}

}}  // namespace palpate::v0
