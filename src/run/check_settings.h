// Checks of settings that a loop starts with, or is to change to.
#pragma once

#include <string>
#include <vector>

#include "palpate/run/run_loop.h"

namespace palpate { inline namespace v0 {

/// Error: a setting that differs and cannot change, by its name in a settings file.
Status check_change(const RunSettings& before, const RunSettings& after);

/// Errors: rates at which the safety filter would never allow a force.
Status check_rates(const RunSettings& settings, const DeviceInfo& device);

/// Returns a note if the device ticks so rarely that the safety filter limits the force.
std::vector<std::string> notes_on_rates(const RunSettings& settings, const DeviceInfo& device);

}}  // namespace palpate::v0
