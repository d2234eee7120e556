// Haply's Inverse3 with or without a VerseGrip, through the Inverse Service on this or another
// computer.
#pragma once

#include <memory>

#include "palpate/devices/devices.h"
#include "src/devices/transport/tcp_socket.h"

namespace palpate { inline namespace v0 {

struct HaplyAddress {
  NetAddress service{"localhost", 10001};
  int event_port = 10020;
};

/// open_haply_device and find_haply_device at a stated place.
Result<std::unique_ptr<HapticDevice>> open_haply_device_at(const HaplyAddress& address);
FoundDevice find_haply_device_at(const HaplyAddress& address);

}}  // namespace palpate::v0
