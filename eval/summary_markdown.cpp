#include <string>

#include "eval/markdown.h"
#include "eval/report.h"

namespace palpate::eval {
namespace {

std::string counts(const Evaluation& evaluation) {
  std::string text;
  for (const auto& [verdict, count] : count_verdicts(evaluation)) {
    text += (text.empty() ? "" : ", ") + std::to_string(count) + " " + name_of(verdict);
  }
  return text;
}

std::string findings(const Evaluation& evaluation, Verdict verdict) {
  std::string text;
  for (const ReportFigure& figure : evaluation.figures) {
    if (!figure.stored) continue;
    for (const Claim& claim : figure.stored->result.claims) {
      if (claim.verdict != verdict) continue;
      text += "* **" + markdown_cell(figure.spec.id) + "** " + markdown_cell(claim.ours) + " *(" +
              markdown_cell(claim.thesis) + ")*\n";
    }
  }
  return text;
}

}  // namespace

std::string summary_markdown(const Evaluation& evaluation) {
  std::string text =
      "# Evaluation\n\n"
      "Every figure of *A Volume-Based Penetration Measure for 6DOF Haptic Rendering of Streaming "
      "Point Clouds*, made\nagain with this program. `make eval` makes the report with all plots "
      "(`build/eval/index.html`, at most 45 minutes on\ntwo cores) and rewrites this page; "
      "`palpate "
      "eval FIGURE -o REPORT` makes one figure, `--quick` all of them in two\nminutes. Sentences, "
      "numbers and verdicts below are computed from the measurements, not written by hand.\n\n"
      "**From:** " +
      markdown_cell(machine_words(evaluation.key)) + "; " + markdown_cell(form_words(evaluation)) +
      "; real frames " + evaluation.key.data + ".\n\n**Verdicts:** " + counts(evaluation) +
      ".\n\nTimes are of single calls on one thread: compare them within one report. All else is "
      "the same on every machine.\n";
  std::string missing;
  int num_earlier = 0;
  for (const ReportFigure& figure : evaluation.figures) {
    if (!figure.stored) {
      missing += (missing.empty() ? "" : ", ") + markdown_cell(figure.spec.id);
    } else if (!figure.is_current) {
      ++num_earlier;
    }
  }
  if (!missing.empty()) text += "\nNot made: " + missing + ".\n";
  if (num_earlier > 0) {
    text += "\n" + std::to_string(num_earlier) +
            " figures are from earlier runs, of another program or with other inputs.\n";
  }
  const std::string contradictions = findings(evaluation, Verdict::contradicts);
  if (!contradictions.empty()) {
    text += "\n## What contradicts the thesis or our documentation\n\n" + contradictions;
  }
  std::string section;
  for (const ReportFigure& figure : evaluation.figures) {
    if (!figure.stored) continue;
    if (section != figure.spec.section) {
      section = figure.spec.section;
      text += "\n## " + section +
              "\n\n| figure | the thesis says | we measure | verdict |\n|---|---|---|---|\n";
    }
    const std::string id = "| " + markdown_cell(figure.spec.id) + " | ";
    if (!figure.stored->failure.empty()) {
      text += id + markdown_cell(figure.spec.title) +
              " | failed: " + markdown_cell(figure.stored->failure) + " | |\n";
      continue;
    }
    for (const Claim& claim : figure.stored->result.claims) {
      text += id + markdown_cell(claim.thesis) + " | " + markdown_cell(claim.ours) + " | " +
              name_of(claim.verdict) + " |\n";
    }
  }
  return text;
}

}  // namespace palpate::eval
