// Manual pages and shell completion, made from the options that the program declares.
#pragma once

#include <CLI/CLI.hpp>
#include <filesystem>

#include "palpate/core/core.h"

namespace palpate::apps {

/// Writes palpate.1, palpate-VERB.1 for each verb, and palpate.bash. Error: the folder cannot be
/// written to.
Status write_manual(const CLI::App& program, const std::filesystem::path& folder);

}  // namespace palpate::apps
