// Texts that quote the report: the guides show its tables, and none that somebody typed.
#pragma once

#include <filesystem>
#include <span>
#include <string>

#include "eval/report/run_evaluation.h"

namespace palpate::eval {

/// Puts the tables of the report into a text. What lies between the lines
///
///     <!-- eval FIGURE: TITLE OF THE TABLE -->
///     <!-- /eval -->
///
/// becomes that table, with the command that makes it. It stays as it is if the figure is not in
/// the report, or could not measure here. An error, with its line, if there is no such figure or
/// table or a mark is alone.
Result<std::string> with_tables(const std::string& markdown, const Evaluation& evaluation);

/// Writes the tables into each text; of a folder into all texts (*.md) in and below it, and
/// evaluation.md beside them. Writes nothing at all if one of them cannot be made.
Status write_docs(const Evaluation& evaluation, std::span<const std::filesystem::path> paths);

}  // namespace palpate::eval
