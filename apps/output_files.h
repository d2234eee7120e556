// Output files of a verb: existing files in their place are checked before the work begins.
#pragma once

#include <filesystem>
#include <string>

#include "palpate/core/core.h"

namespace palpate::apps {

/// Kind of an output file; the name of a mesh, also of caps, determines its format.
enum class OutputKind { tool, robot, mesh, table, page, stamp, recording, rig, sensor };

/// True if two names, also through links, refer to the same file.
bool is_same_file(const std::filesystem::path& a, const std::filesystem::path& b);
/// Checks before hours of work that a file can be written to `path`: its folder exists and is
/// writable, an existing file is of the same kind (or empty) and will be replaced, and it is not
/// the file `input`.
Status check_output_file(const std::filesystem::path& path, OutputKind kind,
                         const std::filesystem::path& input = {});
/// Ends in wrong usage unless a mesh can be written under this name.
void check_mesh_name(const std::string& flag, const std::filesystem::path& path);

}  // namespace palpate::apps
