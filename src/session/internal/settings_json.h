// Settings as JSON: in recordings, summaries and the messages of the page.
#pragma once

#include <nlohmann/json_fwd.hpp>
#include <optional>

#include "palpate/cloud/depth_source.h"
#include "palpate/session/run.h"
#include "palpate/settings/setting_table.h"

namespace palpate { inline namespace v0 {

/// {section: {name: value}}
nlohmann::ordered_json to_json(const SettingTable& table);
/// Sets all of them. Errors: one that is missing, not known, or out of range.
Status read_json(SettingTable table, const nlohmann::ordered_json& json);

nlohmann::ordered_json value_to_json(const Setting& setting);
/// nullopt: no setting is like that.
std::optional<SettingValue> value_from_json(const nlohmann::ordered_json& json);

nlohmann::ordered_json to_json(const ProbeChoice& probe);
/// Throws nlohmann::json::exception for missing or ill-typed members.
ProbeChoice probe_from_json(const nlohmann::ordered_json& json);

nlohmann::ordered_json to_json(const DepthStreamInfo& stream);
nlohmann::ordered_json to_json(const std::vector<DepthStreamInfo>& streams);
DepthStreamInfo stream_from_json(const nlohmann::ordered_json& json);

}}  // namespace palpate::v0
