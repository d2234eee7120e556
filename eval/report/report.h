// The report for humans: one page, self-contained; and its summary as Markdown.
#pragma once

#include <map>
#include <string>

#include "eval/report/run_evaluation.h"

namespace palpate::eval {

inline constexpr const char* kReportPage = "index.html";

/// Makes the whole report. Contradictions to the thesis or our documentation come first. Error:
/// this build has no pages.
Result<std::string> evaluation_page(const Evaluation& evaluation);

/// Makes the tables of claims, findings and verdicts for docs/evaluation.md.
std::string summary_markdown(const Evaluation& evaluation);

inline constexpr Source kSources[] = {Source::thesis, Source::ours, Source::docs};
/// "Claims of the thesis", ...
const char* heading_of(Source source);
/// Claims of a figure and, if it was made on a GPU too, the same ones of that; `where` names the
/// machine, if not this one.
struct PlacedClaim {
  std::string where;
  Claim claim;
};
std::vector<PlacedClaim> claims_of(const ReportFigure& figure);
/// Counts the verdicts of one source's claims; as words: "12 agrees, 3 differs".
std::map<Verdict, int> count_verdicts(const Evaluation& evaluation, Source source);
std::string counts_words(const Evaluation& evaluation, Source source);
/// True for verdicts that contradict the thesis or our claims, which a report shows first.
constexpr bool is_against(Verdict verdict) {
  return verdict == Verdict::contradicts || verdict == Verdict::worse || verdict == Verdict::fails;
}

/// "made on AMD EPYC, 2 cores, avx2", "2026-11-21, commit 0123abc, full form": the wording of all
/// texts.
std::string machine_words(const Key& key);
std::string form_words(const Evaluation& evaluation);

}  // namespace palpate::eval
