// A device behind a VRPN server: NAME@HOST[:PORT].
#pragma once

#include "palpate/devices/devices.h"
#include "src/devices/transport/tcp_socket.h"

namespace palpate { inline namespace v0 {

inline constexpr int kVrpnPort = 3883;

/// find_vrpn_device at a stated place.
FoundDevice find_vrpn_device_at(const NetAddress& address);

}}  // namespace palpate::v0
