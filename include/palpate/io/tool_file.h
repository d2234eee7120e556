// The tool file (.palp): one versioned, checksummed file with mesh, spheres and leaf graph.
#pragma once

#include <filesystem>
#include <string>
#include <string_view>

#include "palpate/core/result.h"
#include "palpate/tool/tool.h"

namespace palpate {

/// Writes to a temporary beside `path`, then renames: never half a file.
Status save_tool(const Tool& tool, const std::filesystem::path& path);

/// Errors: not a tool file, newer version, truncated, checksum does not match, values out of range.
/// Sizes are checked against the file's length before anything is allocated.
Result<Tool> load_tool(const std::filesystem::path& path);

/// What such a file holds. Errors: as above; messages begin with what is wrong, not with a name.
Result<std::string> tool_to_bytes(const Tool& tool);
Result<Tool> tool_from_bytes(std::string_view bytes);

}  // namespace palpate
