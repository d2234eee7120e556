// Tables of the report in the documentation, so that no number is typed by hand.
#pragma once

#include <filesystem>
#include <span>
#include <string>

#include "eval/report/run_evaluation.h"

namespace palpate::eval {

/// Puts the tables of the report into a text. The lines between
///
///     <!-- eval FIGURE: TITLE OF THE TABLE -->
///     <!-- /eval -->
///
/// become that table, with the command that makes it. They stay if the figure is not in the report
/// or could not be measured here. An error, with its line, if there is no such figure or table or a
/// mark is unpaired.
Result<std::string> with_tables(const std::string& markdown, const Evaluation& evaluation);

/// Writes the tables into each text; for a folder into all its texts (*.md), recursively, and
/// evaluation.md beside them. Writes nothing at all if one of them cannot be made.
Status write_docs(const Evaluation& evaluation, std::span<const std::filesystem::path> paths);

}  // namespace palpate::eval
