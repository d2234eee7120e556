// The text of --help: wrapped to the terminal, and short enough to be read.
//
// A verb whose whole help has more than 45 lines shows the options that a first user needs
// (kFirstOptions); --help-all shows all of them. Both come from the descriptions that the manual
// pages are made of, so that nothing is said twice.
#pragma once

#include <CLI/CLI.hpp>
#include <string>

namespace palpate::apps {

/// Returns the help of a program or verb in lines of at most `width` columns; with `is_all` all of
/// it, however long.
std::string help_text(const CLI::App& app, std::size_t width, bool is_all);

/// Makes `app`, and the verbs that are added later, print help_text() for --help and --help-all.
void use_help_text(CLI::App& app);

}  // namespace palpate::apps
