// Checks that ticks and queries come often enough for a force.
#pragma once

#include <string>
#include <vector>

#include "palpate/run/run_loop.h"

namespace palpate { inline namespace v0 {

/// Errors: rates at which the safety filter would never allow a force.
Status check_rates(const RunSettings& settings, const DeviceInfo& device);

/// Returns a note if the device ticks so rarely that the safety filter limits the force.
std::vector<std::string> notes_on_rates(const RunSettings& settings, const DeviceInfo& device);

}}  // namespace palpate::v0
