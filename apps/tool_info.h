// What there is to tell about a tool.
#pragma once

#include <nlohmann/json_fwd.hpp>
#include <string>

#include "palpate/tool/tool.h"

namespace palpate::apps {

/// The keys of `palpate info --json`.
nlohmann::ordered_json tool_info(const Tool& tool);
/// The same in a few lines for people.
std::string describe(const Tool& tool);
/// Prints one document to stdout.
void print_json(const nlohmann::ordered_json& json);

}  // namespace palpate::apps
