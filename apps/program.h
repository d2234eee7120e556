// Common parts of all programs of this folder: one line for an error, and the
// exit status.
#pragma once

#include <CLI/CLI.hpp>
#include <filesystem>
#include <string>

#include "apps/verbs.h"
#include "palpate/core/core.h"

namespace palpate::apps {

/// Exit status for errors of the input or the environment, and for wrong usage.
inline constexpr int kInputAtFault = 1, kWrongUsage = 2;

/// Prints one line on stderr, printable even if the message quotes a file that is not text. Returns
/// `status`.
int fail(const std::string& program, const std::string& message, int status);

/// Adds --help, --version, --licenses and --quiet.
void add_common_options(CLI::App& program);
/// Adds --quiet, to a verb.
void add_quiet_flag(CLI::App& app);

/// Parses the command line and does the work that parsing has put into `action`. Returns the exit
/// status.
int run_program(CLI::App& program, const Action& action, int argc, char** argv);

/// Writes palpate.1, palpate-VERB.1 for each verb, and palpate.bash. Error: the folder cannot be
/// written to.
Status write_manual(const CLI::App& program, const std::filesystem::path& folder);

}  // namespace palpate::apps
