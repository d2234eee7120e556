#include <string>

#include "eval/report/markdown.h"
#include "eval/report/report.h"

namespace palpate::eval {
namespace {

std::string findings(const Evaluation& evaluation) {
  std::string text;
  for (const ReportFigure& figure : evaluation.figures) {
    if (!figure.stored) continue;
    for (const auto& [where, claim] : claims_of(figure)) {
      if (!is_against(claim.verdict)) continue;
      text += "* **" + markdown_cell(figure.spec.id) + "**, " + name_of(claim.verdict) + ": " +
              markdown_cell(claim.measured) + " *(" + markdown_cell(claim.claim + where) + ")*\n";
    }
  }
  return text;
}

/// Makes the tables of all claims of one source, by section.
std::string claim_tables(const Evaluation& evaluation, Source source) {
  std::string text, section;
  for (const ReportFigure& figure : evaluation.figures) {
    if (!figure.stored) continue;
    for (const auto& [where, claim] : claims_of(figure)) {
      if (claim.source != source) continue;
      if (section != figure.spec.section) {
        section = figure.spec.section;
        text += "\n### " + section +
                "\n\n| figure | claim | we measure | verdict |\n|---|---|---|---|\n";
      }
      text += "| " + markdown_cell(figure.spec.id) + " | " + markdown_cell(claim.claim + where) +
              " | " + markdown_cell(claim.measured) + " | " + name_of(claim.verdict) + " |\n";
    }
  }
  if (text.empty()) return "";
  return std::string("\n## ") + heading_of(source) + "\n" + text;
}

/// Writes the line that tools/check_evaluation.py reads.
std::string arithmetic(const Evaluation& evaluation) {
  if (evaluation.golden.empty()) return "";
  return "**Arithmetic:** `tests/contact/golden.txt` of hash `" + evaluation.golden +
         "`; if that is not today's, the top of this page says so.\n\n";
}

constexpr const char* kRules =
    "In the figures of the thesis the graph is the thesis' own (gap rule `absolute`), with ours "
    "beside it where that matters; our studies, the\nrows of graphics cards and the tables of the "
    "guides have the graph that `palpate pack` makes by default (`relative`). Volumes, forces and\n"
    "directions are compared with all methods counting the same volumes. Numbers within a tenth of "
    "each other are a tie. One run has one\nverdict, and times of other machines have none.\n";

}  // namespace

std::string summary_markdown(const Evaluation& evaluation) {
  std::string text =
      "# Evaluation\n\n"
      "Every figure of *A Volume-Based Penetration Measure for 6DOF Haptic Rendering of Streaming "
      "Point Clouds*, made\nagain with this program. `make eval` makes the report with all plots "
      "(`build/eval/index.html`, at most 45 minutes on\ntwo cores) and rewrites this page; "
      "`make eval FIGURE=5.1` makes one figure, `make eval-quick` all of them in two\nminutes. "
      "Sentences, "
      "numbers and verdicts below are computed from the measurements, not written by hand.\n\n"
      "**From:** " +
      markdown_cell(machine_words(evaluation.key)) + "; " + markdown_cell(form_words(evaluation)) +
      "; real frames " + evaluation.key.data + ".\n\n" + arithmetic(evaluation) +
      "**Claims of the thesis** (do its methods, built as printed and corrected, show what it "
      "says?): " +
      counts_words(evaluation, Source::thesis) +
      ".\n\n**Is Palpate better** than those methods and other libraries? " +
      counts_words(evaluation, Source::ours) + ".\n\n**Do our own claims hold?** " +
      counts_words(evaluation, Source::docs) +
      ".\n\nTimes are of single calls on one thread: compare them within one report. All else is "
      "the same on every machine.\n\n" +
      kRules;
  std::string missing, drawn;
  int num_earlier = 0;
  for (const ReportFigure& figure : evaluation.figures) {
    if (!figure.stored) {
      missing += (missing.empty() ? "" : ", ") + markdown_cell(figure.spec.id);
      continue;
    }
    num_earlier += !figure.is_current;
    if (claims_of(figure).empty() && figure.stored->failure.empty()) {
      drawn += (drawn.empty() ? "" : ", ") + markdown_cell(figure.spec.id);
    }
  }
  if (!drawn.empty()) text += "\nDrawn, in the report only: " + drawn + ".\n";
  if (!missing.empty()) text += "\nNot made: " + missing + ".\n";
  if (num_earlier > 0) {
    text += "\n" + std::to_string(num_earlier) +
            " figures are from earlier runs, of another program or with other inputs.\n";
  }
  for (const ReportFigure& figure : evaluation.figures) {
    if (!figure.stored || figure.stored->failure.empty()) continue;
    text += "\nFailed: " + markdown_cell(figure.spec.id) + ": " +
            markdown_cell(figure.stored->failure) + "\n";
  }
  const std::string against = findings(evaluation);
  if (!against.empty()) {
    text += "\n## Results against the thesis, or against us\n\n" + against;
  }
  for (const Source source : kSources) text += claim_tables(evaluation, source);
  return text;
}

}  // namespace palpate::eval
