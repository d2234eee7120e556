// Settings as JSON: in recordings, summaries and the messages of the page.
#pragma once

#include <nlohmann/json_fwd.hpp>
#include <optional>

#include "palpate/session/session.h"

namespace palpate {

/// {section: {name: value}}
nlohmann::ordered_json to_json(const SettingTable& table);
/// Sets all of them. Errors: one that is missing, not known, or out of range.
Status read_json(SettingTable table, const nlohmann::ordered_json& json);

nlohmann::ordered_json value_to_json(const Setting& setting);
/// nullopt: no setting is like that.
std::optional<SettingValue> value_from_json(const nlohmann::ordered_json& json);

/// With objects and probe.
nlohmann::ordered_json to_json(const RunSettings& settings);
/// Objects come back without their shapes, which recordings keep in files of their own. Throws
/// nlohmann::json::exception for objects or a probe with missing or ill-typed members.
Result<RunSettings> settings_from_json(nlohmann::ordered_json json);

nlohmann::ordered_json to_json(const ProbeChoice& probe);
/// Throws as above.
ProbeChoice probe_from_json(const nlohmann::ordered_json& json);

nlohmann::ordered_json to_json(const DepthStreamInfo& stream);
DepthStreamInfo stream_from_json(const nlohmann::ordered_json& json);

}  // namespace palpate
