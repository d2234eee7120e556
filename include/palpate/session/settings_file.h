// Settings as people write them: TOML files.
#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "palpate/settings/setting_table.h"

namespace palpate {

/// Sets what the file names, [coupling] stiffness = 800, and returns the keys. Errors: file and
/// line of what cannot be read, a key that is not in the table (with the nearest one), a value out
/// of range. Then the settings are partly those of the file.
Result<std::vector<std::string>> read_settings_file(const std::filesystem::path& path,
                                                    SettingTable table);

/// What the file does not name is as in `defaults`.
template <class Options>
Result<Options> load_settings(const std::filesystem::path& path, Options defaults = {}) {
  const auto read = read_settings_file(path, settings_of(defaults));
  if (!read) return read.error();
  return defaults;
}

/// Such a file with the values as they are, and a comment on every key: what it means, its range
/// and its unit.
std::string settings_toml(const SettingTable& table);

}  // namespace palpate
