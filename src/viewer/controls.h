// What a person may turn while looking on: settings, by the names that files use.
#pragma once

#include <nlohmann/json.hpp>
#include <span>
#include <string>
#include <string_view>

#include "palpate/run/haptic_loop.h"

namespace palpate {

/// Sections of settings, or single ones.
using ControlNames = std::span<const std::string_view>;

/// What HapticLoop::change changes, but where device and tool are.
inline constexpr std::string_view kLiveControls[] = {
    "contact", "surface", "field", "time", "loop.backend", "loop.contact_rate", "coupling"};
/// What decides how a recorded frame is felt.
inline constexpr std::string_view kRecordedControls[] = {"contact", "surface", "field", "time"};

/// `controls` of the protocol: a list with range or choices, and the present values.
nlohmann::ordered_json list_controls(const HapticSettings& settings, ControlNames names);
/// {key: value} of each control.
nlohmann::ordered_json control_values(const HapticSettings& settings, ControlNames names);
/// Turns one. Returns the value as it is now: whole numbers are rounded. Errors: no such control;
/// what it can be; then nothing has changed.
Result<nlohmann::ordered_json> set_control(HapticSettings& settings, ControlNames names,
                                           std::string_view key,
                                           const nlohmann::ordered_json& value);

}  // namespace palpate
