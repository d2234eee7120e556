// Whether a device ticks, and queries come, often enough for a force.
#pragma once

#include <string>
#include <vector>

#include "palpate/run/run_loop.h"

namespace palpate::inline v0 {

/// Errors: by the limits of the safety filter there would never be a force.
Status check_rates(const RunSettings& settings, const DeviceInfo& device);

/// For humans: that the device ticks so rarely that the safety filter keeps force back.
std::vector<std::string> notes_on_rates(const RunSettings& settings, const DeviceInfo& device);

}  // namespace palpate::inline v0
