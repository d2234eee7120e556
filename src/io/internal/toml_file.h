// Reads TOML files of users, with line numbers in errors.
#pragma once

#define TOML_EXCEPTIONS 0
#include <toml++/toml.h>

#include <filesystem>

#include "palpate/core/core.h"

namespace palpate::inline v0 {

/// Outside of strings, letters beyond ASCII become '?'. Errors: no such file, too large, not TOML,
/// with the line.
Result<toml::table> read_toml(const std::filesystem::path& path);

}  // namespace palpate::inline v0
