// A summary of a tool, as text and JSON.
#pragma once

#include <nlohmann/json_fwd.hpp>
#include <string>

#include "src/session/internal/packing_report.h"

namespace palpate::apps {

/// Returns the JSON of `palpate info --json`; `standoff` is that of the tool.
nlohmann::ordered_json tool_info(const Tool& tool, const Standoff& standoff);
/// The same in a few lines for humans.
std::string describe(const Tool& tool, const Standoff& standoff);
/// Prints a note on stderr about a part of the tool without spheres; `path`: the file of the tool.
void warn_of_empty_part(const std::string& path, const Tool& tool, const Standoff& standoff);
/// Prints one document to stdout.
void print_json(const nlohmann::ordered_json& json);

}  // namespace palpate::apps
