#include "eval/report/doc_tables.h"

#include <algorithm>
#include <fstream>
#include <map>
#include <optional>
#include <sstream>
#include <string_view>

#include "eval/report/markdown.h"
#include "eval/report/report.h"
#include "src/io/internal/atomic_file.h"

namespace palpate::eval {
namespace {

namespace fs = std::filesystem;

constexpr std::string_view kBegin = "<!-- eval ", kBeginEnd = " -->", kEnd = "<!-- /eval -->";

/// Table that a mark requests.
struct Quote {
  std::string figure, title;
};
std::optional<Quote> parse_mark(const std::string& line) {
  if (!line.starts_with(kBegin) || !line.ends_with(kBeginEnd)) return std::nullopt;
  const std::string inner =
      line.substr(kBegin.size(), line.size() - kBegin.size() - kBeginEnd.size());
  const std::size_t colon = inner.find(": ");
  if (colon == std::string::npos) return std::nullopt;
  return Quote{inner.substr(0, colon), inner.substr(colon + 2)};
}

/// Returns the machine and commit of rows that another program has measured.
std::string rows_of(const StoredFigure& figure) {
  const std::string& place = figure.result.rows_of;
  return place.empty() ? "" : "; rows of " + markdown_cell(place);
}

/// Returns the block of a quote; nullopt: keep the present one.
Result<std::optional<std::string>> block_of(const Quote& quote, const Evaluation& evaluation) {
  const auto figure = std::find_if(
      evaluation.figures.begin(), evaluation.figures.end(),
      [&](const ReportFigure& candidate) { return quote.figure == candidate.spec.id; });
  if (figure == evaluation.figures.end()) {
    return Error{Errc::not_found,
                 "there is no figure '" + quote.figure + "'; palpate_eval --list shows all"};
  }
  if (!figure->stored || !figure->stored->failure.empty()) return std::optional<std::string>();
  const auto& tables = figure->stored->result.tables;
  const auto table = std::find_if(tables.begin(), tables.end(), [&](const Table& candidate) {
    return candidate.title == quote.title;
  });
  if (table == tables.end()) {
    const auto& claims = figure->stored->result.claims;
    const bool is_measured = std::ranges::none_of(
        claims, [](const Claim& claim) { return claim.verdict == Verdict::not_measured; });
    if (!is_measured) return std::optional<std::string>();
    std::string titles;
    for (const Table& each : tables) titles += (titles.empty() ? "'" : ", '") + each.title + "'";
    return Error{Errc::not_found, "figure " + quote.figure + " has no table '" + quote.title +
                                      "'; it has " + (titles.empty() ? "none" : titles)};
  }
  return std::optional("\n" + markdown_table(*table) + "\n*Evaluation, " +
                       markdown_cell(quote.figure) + ": `make eval FIGURE=" + quote.figure + "`" +
                       rows_of(*figure->stored) + ".*\n\n");
}

Result<std::string> read_text(const fs::path& path) {
  std::ifstream file(path, std::ios::binary);
  std::ostringstream text;
  text << file.rdbuf();
  if (!file) return Error{Errc::io_failure, "cannot read " + path.string()};
  return text.str();
}

/// Adds the text with its tables to `changed` if they differ from the file.
Status quote_tables(const fs::path& path, const Evaluation& evaluation,
                    std::map<fs::path, std::string>& changed) {
  const auto text = read_text(path);
  if (!text) return text.error();
  auto updated = with_tables(*text, evaluation);
  if (!updated) return Error{updated.error().code, path.string() + ", " + updated.error().message};
  if (*updated != *text) changed[path] = *std::move(updated);
  return Done{};
}

}  // namespace

Result<std::string> with_tables(const std::string& markdown, const Evaluation& evaluation) {
  std::istringstream lines(markdown);
  std::string text, line, kept;
  std::optional<std::string> block;  // of the open mark
  int number = 0, open_at = 0;
  while (std::getline(lines, line)) {
    ++number;
    const std::string where = "line " + std::to_string(number) + ": ";
    const bool is_begin = line.starts_with(kBegin), is_end = line == kEnd;
    if (is_begin ? open_at > 0 : is_end && open_at == 0) {
      return Error{Errc::bad_input,
                   where + "'" + line + "' has no partner; a table stands between '" +
                       std::string(kBegin) + "FIGURE: TITLE" + std::string(kBeginEnd) + "' and '" +
                       std::string(kEnd) + "'"};
    }
    if (is_begin) {
      const auto quote = parse_mark(line);
      if (!quote) {
        return Error{Errc::bad_input, where + "'" + line + "' is not '" + std::string(kBegin) +
                                          "FIGURE: TITLE" + std::string(kBeginEnd) + "'"};
      }
      auto made = block_of(*quote, evaluation);
      if (!made) return Error{made.error().code, where + made.error().message};
      block = *std::move(made);
      kept.clear();
      open_at = number;
    } else if (is_end) {
      text += block.value_or(kept);
      open_at = 0;
    } else if (open_at > 0) {
      kept += line + "\n";
      continue;
    }
    text += line + "\n";
  }
  if (open_at > 0) {
    return Error{Errc::bad_input,
                 "line " + std::to_string(open_at) + ": no '" + std::string(kEnd) + "' follows"};
  }
  return text;
}

Status write_docs(const Evaluation& evaluation, std::span<const fs::path> paths) {
  std::map<fs::path, std::string> changed;
  for (const fs::path& path : paths) {
    if (!fs::is_directory(path)) {
      if (Status status = quote_tables(path, evaluation, changed); !status) return status;
      continue;
    }
    const fs::path summary = path / "evaluation.md";
    std::error_code error;
    for (fs::recursive_directory_iterator entry(path, error), end; !error && entry != end;
         entry.increment(error)) {
      if (entry->path().extension() != ".md" || entry->path() == summary) continue;
      if (Status status = quote_tables(entry->path(), evaluation, changed); !status) return status;
    }
    if (error) {
      return Error{Errc::io_failure, "cannot read the folder " + path.string() + ": " +
                                         error.message() + "; give the one that holds the texts"};
    }
    changed[summary] = summary_markdown(evaluation);
  }
  for (const auto& [path, text] : changed) {
    if (Status status = write_file_atomically(path, text); !status) return status;
  }
  return Done{};
}

}  // namespace palpate::eval
