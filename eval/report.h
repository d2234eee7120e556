// The report for people: one page, self-contained; and its summary as Markdown.
#pragma once

#include <map>
#include <string>

#include "eval/run_evaluation.h"

namespace palpate::eval {

inline constexpr const char* kReportPage = "index.html";

/// The whole report. What contradicts the thesis or our documentation comes first.
std::string report_page(const Evaluation& evaluation);

/// Claims, findings and verdicts as a table for docs/evaluation.md.
std::string summary_markdown(const Evaluation& evaluation);

/// How many claims came to each verdict.
std::map<Verdict, int> count_verdicts(const Evaluation& evaluation);

/// "made on AMD EPYC, 2 cores, avx2", "2026-11-21, commit 0123abc, full form": the same words in
/// all texts.
std::string machine_words(const Key& key);
std::string form_words(const Evaluation& evaluation);

}  // namespace palpate::eval
