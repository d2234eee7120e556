// The protocol of spacenavd, the daemon for 6-DOF mice, as far as a listener needs it: a local
// stream socket on which it writes events of eight native 32-bit integers.
//
//   motion   0  x y z  rx ry rz  milliseconds since the last one
//   press    1  number of the button
//   release  2  number of the button
//
// A client that says nothing is spoken to in version 0 of the protocol, which has just these
// (proto_unix.c of spacenavd, proto.h of libspnav).
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <string>
#include <string_view>
#include <utility>

#include "palpate/core/core.h"

namespace palpate { inline namespace v0 {

class SpacenavConnection {
 public:
  SpacenavConnection() = default;
  SpacenavConnection(SpacenavConnection&& other) noexcept { *this = std::move(other); }
  SpacenavConnection& operator=(SpacenavConnection&& other) noexcept {
    std::swap(socket_, other.socket_);
    std::swap(received_, other.received_);
    std::swap(num_received_, other.num_received_);
    std::swap(num_unknown_, other.num_unknown_);
    return *this;
  }
  ~SpacenavConnection();

  /// Does not wait. Errors: no daemon listens there, or it is no socket; what to do.
  static Result<SpacenavConnection> open(const std::string& path);
  bool is_open() const { return socket_ >= 0; }

  enum class Answer { event, nothing_yet, closed, not_understood };
  using Event = std::array<std::int32_t, 8>;
  enum EventType : std::int32_t { kMotion = 0, kPress = 1, kRelease = 2 };
  /// The next whole event that has come. Does not wait or allocate. Types that are unknown are
  /// passed over; many of them in a row are not understood.
  Answer next(Event& event) noexcept;

 private:
  int socket_ = -1;
  std::array<std::byte, sizeof(Event)> received_{};
  std::size_t num_received_ = 0;
  int num_unknown_ = 0;
};

/// The given path, else $SPNAV_SOCKET as for libspnav, else the daemon's usual one.
std::string spacenav_socket_path(std::string_view given);

}}  // namespace palpate::v0
