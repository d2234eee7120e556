// Text of the report as Markdown.
#pragma once

#include <string>

#include "eval/figure.h"

namespace palpate::eval {

/// Formats one cell of a table: no line breaks, no column marks, no accidental markup.
std::string markdown_cell(const std::string& text);

/// Formats the table without its title, each line with a line break.
std::string markdown_table(const Table& table);

}  // namespace palpate::eval
