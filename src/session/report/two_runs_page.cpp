// The page of two runs: the data of both reports as they are. What is compared, the page computes.
#include <nlohmann/json.hpp>

#include "src/io/internal/atomic_file.h"
#include "src/pages/internal/pages.h"
#include "src/session/internal/compact_json.h"
#include "src/session/internal/run_folder.h"

namespace palpate { inline namespace v0 {
namespace {

using Json = nlohmann::ordered_json;

// Around the data of a report (web/report_template.html).
constexpr std::string_view kBegin = "id=\"data\">", kEnd = "</script>";

/// Returns the data of the report in the folder of a run.
Result<Json> report_data(const std::filesystem::path& run) {
  const std::filesystem::path path = run / "report.html";
  std::error_code ignored;
  if (recording_parts(run).empty()) {
    return Error{Errc::bad_input,
                 run.string() + ": this is not the folder of a run: it holds no " + kRecordingFile};
  }
  if (!std::filesystem::exists(path, ignored)) {
    return Error{Errc::bad_input, run.string() + ": this run has no report.html; 'palpate replay " +
                                      run.string() + " -o NEW' makes the run again, with one"};
  }
  const auto text = read_file(path);
  if (!text) return text.error();
  const Error damaged{Errc::bad_input, path.string() + ": no report of a run; 'palpate replay " +
                                           run.string() + " -o NEW' makes the run again, with one"};
  const std::size_t begin = text->find(kBegin);
  if (begin == std::string::npos) return damaged;
  const std::size_t from = begin + kBegin.size(), end = text->find(kEnd, from);
  if (end == std::string::npos) return damaged;
  Json data = Json::parse(text->begin() + static_cast<std::ptrdiff_t>(from),
                          text->begin() + static_cast<std::ptrdiff_t>(end), nullptr, false);
  if (!data.is_object() || data.value("kind", "") != "run" || !data.contains("series")) {
    return damaged;
  }
  return data;
}

/// Returns what the folders are called, told apart by more of their paths where that is needed.
std::pair<std::string, std::string> names_of(const std::filesystem::path& a,
                                             const std::filesystem::path& b) {
  const auto last = [](const std::filesystem::path& path) {
    return (path.filename().empty() ? path.parent_path() : path).filename().string();
  };
  if (last(a) != last(b)) return {last(a), last(b)};
  return {a.string(), b.string()};
}

}  // namespace

Result<std::string> two_runs_page(const std::filesystem::path& a, const std::filesystem::path& b) {
  auto first = report_data(a), second = report_data(b);
  if (!first) return first.error();
  if (!second) return second.error();
  const auto [name_a, name_b] = names_of(a, b);
  const Json page{{"kind", "two_runs"},
                  {"names", {name_a, name_b}},
                  {"runs", {*std::move(first), *std::move(second)}}};
  return report_page("Palpate: " + name_a + " and " + name_b, page_text(page));
}

}}  // namespace palpate::v0
