// Files that a verb writes: what is in their place is checked before the work begins.
#pragma once

#include <filesystem>
#include <string>

#include "palpate/core/core.h"

namespace palpate::apps {

/// What is written; a mesh, also of caps, has its format in its name.
enum class OutputKind { tool, mesh, table, page, stamp, recording, rig };

/// Do two names, through links too, mean one file?
bool is_same_file(const std::filesystem::path& a, const std::filesystem::path& b);
/// A file can be written to `path` as far as one can see before hours of work: its folder exists
/// and may be written to, nothing has its name but a file of the same kind (or an empty one), which
/// it replaces, and it is not the file `input`.
Status check_output_file(const std::filesystem::path& path, OutputKind kind,
                         const std::filesystem::path& input = {});
/// Wrong usage unless a mesh can be written under this name.
void check_mesh_name(const std::string& flag, const std::filesystem::path& path);

}  // namespace palpate::apps
