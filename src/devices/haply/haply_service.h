// Haply's Inverse Service at an address: a connection to it, and the devices that it has. Both
// are needed before a run only; nothing here is called at a tick.
#pragma once

#include <optional>
#include <string>

#include "palpate/core/core.h"
#include "src/devices/haply/haply_messages.h"
#include "src/devices/transport/tcp_socket.h"
#include "src/devices/transport/web_socket.h"

namespace palpate { inline namespace v0 {

inline constexpr double kHaplyAnswerTimeout = 1.0;  // s for anything before the first tick

/// Returns "ws://HOST:PORT", for messages.
std::string haply_url(const NetAddress& address);

/// A connection on which the service has said what there is.
struct HaplyConnection {
  WebSocket socket;
  HaplyMessage inventory;  // points into the last message received
};
/// Connects to the service. `timeout`: s. Error: nobody answers, or not as an Inverse Service.
Result<HaplyConnection> connect_to_haply(const NetAddress& address, double timeout);

/// Devices found at an address, as copies.
struct HaplyInventory {
  std::optional<HaplyVersion> version;
  std::string device_id, grip_id;
  HaplyKind grip_kind = HaplyKind::verse_grip;
};
/// Returns the first Inverse3 of the service, and a grip that is connected. `timeout`: s. Errors:
/// those of the connection; a service that is too old; no Inverse3.
Result<HaplyInventory> inspect_haply(const NetAddress& address, double timeout);
/// Names the devices, the address and the version, for users.
std::string describe(const HaplyInventory& found, const NetAddress& address);

}}  // namespace palpate::v0
