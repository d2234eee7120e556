// Run settings as JSON.
#pragma once

#include <nlohmann/json_fwd.hpp>

#include "palpate/session/session.h"

namespace palpate {

nlohmann::ordered_json to_json(const RunSettings& settings);
/// Objects come back without their shapes, which recordings keep in files of their own. Throws
/// nlohmann::json::exception for missing or ill-typed members.
Result<RunSettings> settings_from_json(const nlohmann::ordered_json& json);

nlohmann::ordered_json to_json(const ProbeChoice& probe);
/// Throws as above.
ProbeChoice probe_from_json(const nlohmann::ordered_json& json);

nlohmann::ordered_json to_json(const DepthStreamInfo& stream);
DepthStreamInfo stream_from_json(const nlohmann::ordered_json& json);

}  // namespace palpate
