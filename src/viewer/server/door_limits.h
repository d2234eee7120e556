// Limits of the viewer's server, for clients that are slow or come too often.
#pragma once

#include <chrono>
#include <memory>

#include "palpate/viewer/viewer.h"

namespace palpate { inline namespace v0 {

struct DoorLimits {
  std::chrono::milliseconds request_time{10'000};  ///< for a whole request, however it trickles in
  std::chrono::milliseconds answer_time{30'000};   ///< until an answer has been taken
  /// Rate of new connections, of all clients together.
  double connections_per_second = 250, connections_at_once = 500;
};

/// ViewServer::start with limits that a test does not have to wait for.
Result<std::unique_ptr<ViewServer>> start_view_server(ViewSource& source,
                                                      const ViewServerOptions& options,
                                                      const DoorLimits& limits);

}}  // namespace palpate::v0
