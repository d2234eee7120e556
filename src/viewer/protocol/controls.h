// Settings that a page may change, by the names that files use.
#pragma once

#include <nlohmann/json.hpp>
#include <string_view>

#include "palpate/run/run_loop.h"

namespace palpate { inline namespace v0 {

/// Predicate that selects the settings that are controls.
using IsControl = bool(const Setting& setting);
/// True for settings that RunLoop::change can change.
inline bool is_live_control(const Setting& setting) { return !is_fixed_while_running(setting); }
/// True for settings that change the contact with a recorded frame.
inline bool is_recorded_control(const Setting& setting) {
  return setting.section == "contact" || setting.section == "surface" ||
         setting.section == "field" || setting.section == "time";
}

/// `controls` of the protocol: a list with range or choices, and the present values.
nlohmann::ordered_json list_controls(const SettingTable& table, IsControl is_control);
/// {key: value} of each control.
nlohmann::ordered_json control_values(const SettingTable& table, IsControl is_control);
/// Sets a control; returns its value, with whole numbers rounded. Errors: no such control, with the
/// nearest one or why it cannot change; a value out of range. Then nothing has changed.
Result<nlohmann::ordered_json> set_control(SettingTable table, IsControl is_control,
                                           std::string_view key,
                                           const nlohmann::ordered_json& value);

}}  // namespace palpate::v0
