#include "eval/report/report.h"

#include <algorithm>
#include <cmath>
#include <filesystem>

#include "eval/report/plot_svg.h"
#include "eval/report/report_style.h"
#include "src/session/html_page.h"
#include "src/session/svg_parts.h"

namespace palpate::eval {
namespace {

/// Colours of the style sheet: good, new, mixed, bad, none.
std::string verdict_class(Verdict verdict) {
  switch (verdict) {
    case Verdict::agrees:
    case Verdict::holds: return "v-agrees";
    case Verdict::better: return "v-better";
    case Verdict::differs:
    case Verdict::even:
    case Verdict::holds_in_part: return "v-differs";
    case Verdict::contradicts:
    case Verdict::worse:
    case Verdict::fails: return "v-contradicts";
    case Verdict::not_comparable:
    case Verdict::not_measured: return "v-unmeasured";
  }
  return "";
}

std::string chip(Verdict verdict) {
  return "<span class='chip " + verdict_class(verdict) + "'>" + name_of(verdict) + "</span>";
}

std::string anchor(const ReportFigure& figure) { return "f-" + file_stem(figure.spec.id); }

std::string link_to(const ReportFigure& figure) {
  return "<a href='#" + anchor(figure) + "'>" + escape_html(figure.spec.id) + "</a>";
}

std::string duration(double seconds) {
  const int whole = static_cast<int>(std::lround(seconds));
  return whole < 100 ? short_number(seconds, 2) + " s" : short_number(seconds / 60.0, 2) + " min";
}

/// Whether a cell reads as a number, perhaps with a unit sign: such columns stand to the right.
bool looks_like_number(const std::string& cell) {
  const std::size_t start = cell.find_first_not_of("+-\u2212 ");
  return start == std::string::npos || (cell[start] >= '0' && cell[start] <= '9');
}

// The first screen -------------------------------------------------------------------------------

std::string verdict_counts(const Evaluation& evaluation) {
  std::string html;
  for (const Source source : kSources) {
    std::string bar = "<div class='share' aria-hidden='true'>", words = "<div class='verdicts'>";
    for (const auto& [verdict, count] : count_verdicts(evaluation, source)) {
      bar += "<i class='" + verdict_class(verdict) + "' style='flex:" + std::to_string(count) +
             "'></i>";
      words += "<span><b>" + std::to_string(count) + "</b>" + chip(verdict) + "</span>";
    }
    html +=
        std::string("<h4>") + heading_of(source) + "</h4>" + bar + "</div>" + words + "</div>\n";
  }
  return html;
}

std::string facts(const Evaluation& evaluation) {
  int num_there = 0;
  double seconds = 0;
  for (const ReportFigure& figure : evaluation.figures) {
    if (!figure.stored) continue;
    ++num_there;
    seconds += figure.stored->seconds;
  }
  const Key& key = evaluation.key;
  std::string inputs = "real frames " + key.data;
  inputs += key.gpu.empty() ? ", no times of a GPU" : ", times of a GPU";
  inputs += key.peers.empty() ? ", no times of other libraries" : ", times of other libraries";
  return "<table class='facts'>" +
         row("figures", std::to_string(num_there) + " of " +
                            std::to_string(evaluation.figures.size()) + ", made in " +
                            duration(seconds)) +
         row("machine", machine_words(key)) + row("form", form_words(evaluation)) +
         row("inputs", inputs) + "<tr><td>made again by</td><td><code>" +
         escape_html(evaluation.command) + "</code></td></tr></table>\n";
}

/// Claims that speak against the thesis or against us, in full.
std::string findings(const Evaluation& evaluation) {
  std::string items;
  for (const ReportFigure& figure : evaluation.figures) {
    if (!figure.stored) continue;
    for (const auto& [where, claim] : claims_of(figure)) {
      if (!is_against(claim.verdict)) continue;
      items += "<dt>" + link_to(figure) + escape_html(where) + " " + escape_html(claim.measured) +
               " " + chip(claim.verdict) + "</dt><dd class='thesis'>" + escape_html(claim.claim) +
               "</dd>";
    }
  }
  if (items.empty()) return "";
  return "<div class='first'><h2>What speaks against the thesis, or against us</h2><dl>" + items +
         "</dl></div>\n";
}

std::string failures(const Evaluation& evaluation) {
  std::string html;
  for (const ReportFigure& figure : evaluation.figures) {
    if (!figure.stored || figure.stored->failure.empty()) continue;
    html += "<p class='warn'>" + link_to(figure) +
            " failed: " + escape_html(figure.stored->failure) + "</p>\n";
  }
  return html;
}

std::string claim_rows(const ReportFigure& figure, const std::string& first_cell, Source source) {
  std::string html;
  for (const auto& [where, claim] : claims_of(figure)) {
    if (claim.source != source) continue;
    html += "<tr>" + first_cell + "<td class='t'>" + escape_html(claim.claim + where) +
            "</td><td class='o'>" + escape_html(claim.measured) + "</td><td class='v'>" +
            chip(claim.verdict) + "</td></tr>\n";
  }
  return html;
}

std::string claim_table(const Evaluation& evaluation, Source source) {
  std::string rows;
  for (const ReportFigure& figure : evaluation.figures) {
    if (!figure.stored || !figure.stored->failure.empty()) continue;
    rows += claim_rows(figure, "<td class='i'>" + link_to(figure) + "</td>", source);
  }
  if (rows.empty()) return "";
  return std::string("<h2 id='all-") + name_of(source) + "'>" + heading_of(source) +
         "</h2><table class='claims'><thead><tr><th>figure</th><th>claim</th><th>we measure</th>"
         "<th>verdict</th></tr></thead>\n" +
         rows + "</table>\n";
}

std::string not_made(const Evaluation& evaluation) {
  std::string missing;
  for (const ReportFigure& figure : evaluation.figures) {
    if (!figure.stored) missing += (missing.empty() ? "" : ", ") + escape_html(figure.spec.id);
  }
  return missing.empty() ? "" : "<p class='sub'>Not made yet: " + missing + ".</p>\n";
}

// The figures ------------------------------------------------------------------------------------

std::string plots(const FigureResult& result) {
  if (result.plots.empty()) return "";
  std::string html = "<div class='plots'>\n";
  for (const Plot& plot : result.plots) {
    html += "<figure><h4>" + escape_html(plot.title) + "</h4>" + draw(plot) + "<figcaption>" +
            escape_html(plot.caption) + "</figcaption></figure>\n";
  }
  return html + "</div>\n";
}

std::string pictures(const FigureResult& result) {
  if (result.pictures.empty()) return "";
  std::string html = "<div class='plots'>\n";
  for (const Picture& picture : result.pictures) {
    html += "<figure><h4>" + escape_html(picture.title) + "</h4><img class='picture' alt='" +
            escape_html(picture.title) + "' src='data:image/png;base64," + picture.png_base64 +
            "'><figcaption>" + escape_html(picture.caption) + "</figcaption></figure>\n";
  }
  return html + "</div>\n";
}

std::string table(const Table& table) {
  std::vector<bool> is_number(table.columns.size(), true);
  for (const auto& cells : table.rows) {
    for (std::size_t i = 0; i < std::min(cells.size(), is_number.size()); ++i) {
      is_number[i] = is_number[i] && looks_like_number(cells[i]);
    }
  }
  const auto cells_of = [&](const std::vector<std::string>& cells, const std::string& tag) {
    std::string html = "<tr>";
    for (std::size_t i = 0; i < cells.size(); ++i) {
      const bool right = i > 0 && i < is_number.size() && is_number[i];
      html += "<" + tag + (right ? " class='n'>" : ">") + escape_html(cells[i]) + "</" + tag + ">";
    }
    return html + "</tr>\n";
  };
  std::string html = "<div class='scroll'><h4>" + escape_html(table.title) +
                     "</h4><table class='data'>" + cells_of(table.columns, "th");
  for (const auto& cells : table.rows) html += cells_of(cells, "td");
  return html + "</table></div>\n";
}

std::string numbers(const StoredFigure& stored) {
  const std::string file = std::string(kDataFolder) + "/" + file_stem(stored.id) + ".json";
  std::string html = "<details><summary>" + std::to_string(stored.result.numbers.size()) +
                     " numbers; all data in <a href='" + escape_html(file) + "'>" +
                     escape_html(file) +
                     "</a> and CSV files beside it</summary><div class='scroll'>"
                     "<table class='data'>";
  for (const Number& number : stored.result.numbers) {
    html += "<tr><td>" + escape_html(number.key) + "</td><td class='n'>" +
            (std::isfinite(number.value) ? short_number(number.value, 5) : "none") + "</td><td>" +
            escape_html(number.unit) + "</td></tr>\n";
  }
  return html + "</table></div></details>\n";
}

std::string section_of(const ReportFigure& figure) {
  std::string html = "<section class='fig'><h3 id='" + anchor(figure) + "'><a class='id' href='#" +
                     anchor(figure) + "'>" + escape_html(figure.spec.id) + "</a>" +
                     escape_html(figure.spec.title) + "</h3>\n";
  const StoredFigure& stored = *figure.stored;
  if (!figure.is_current) {
    html += "<p class='sub'>From an earlier run: " + escape_html(stored.made) + ", " +
            escape_html(stored.key.form) + " form, " +
            escape_html(stored.commit.empty() ? "commit not told" : "commit " + stored.commit) +
            ", " + escape_html(machine_words(stored.key)) + ".</p>\n";
  }
  if (!stored.failure.empty()) {
    return html + "<p class='warn'>Failed: " + escape_html(stored.failure) + "</p></section>\n";
  }
  for (const Source source : kSources) {
    const std::string rows = claim_rows(figure, "", source);
    if (rows.empty()) continue;
    html += std::string("<table class='claims'><thead><tr><th>") + heading_of(source) +
            "</th><th>we measure</th><th>verdict</th></tr></thead>\n" + rows + "</table>\n";
  }
  html += pictures(stored.result) + plots(stored.result);
  for (const Table& t : stored.result.tables) html += table(t);
  if (figure.on_gpu) {
    const StoredFigure& gpu = *figure.on_gpu;
    html += "<p class='sub'>The same, " + escape_html(gpu.key.isa) + " (" + escape_html(gpu.made) +
            ", commit " + escape_html(gpu.commit) + "):</p>" + plots(gpu.result);
    for (const Table& t : gpu.result.tables) html += table(t);
  }
  if (!stored.result.notes.empty()) {
    html += "<ul class='notes'>";
    for (const std::string& note : stored.result.notes)
      html += "<li>" + escape_html(note) + "</li>";
    html += "</ul>\n";
  }
  if (!stored.result.numbers.empty() || !stored.result.plots.empty()) html += numbers(stored);
  return html + "</section>\n";
}

/// Names of the sections that have figures, in their order.
std::vector<std::string> sections(const Evaluation& evaluation) {
  std::vector<std::string> names;
  for (const ReportFigure& figure : evaluation.figures) {
    if (!figure.stored) continue;
    if (std::find(names.begin(), names.end(), figure.spec.section) == names.end()) {
      names.emplace_back(figure.spec.section);
    }
  }
  return names;
}

}  // namespace

const char* heading_of(Source source) {
  switch (source) {
    case Source::thesis: return "Claims of the thesis";
    case Source::ours: return "Is ours better?";
    case Source::docs: return "What we say of our own";
  }
  return "";
}

std::vector<PlacedClaim> claims_of(const ReportFigure& figure) {
  std::vector<PlacedClaim> claims;
  const std::string& rows_of = figure.stored->result.rows_of;
  for (const Claim& claim : figure.stored->result.claims) {
    claims.push_back({rows_of.empty() ? "" : " (rows of " + rows_of + ")", claim});
  }
  if (!figure.on_gpu) return claims;
  for (const Claim& claim : figure.on_gpu->result.claims) {
    claims.push_back(
        {" (" + figure.on_gpu->key.isa + ", commit " + figure.on_gpu->commit + ")", claim});
  }
  return claims;
}

std::map<Verdict, int> count_verdicts(const Evaluation& evaluation, Source source) {
  std::map<Verdict, int> counts;
  for (const ReportFigure& figure : evaluation.figures) {
    if (!figure.stored) continue;
    for (const auto& [where, claim] : claims_of(figure)) {
      if (claim.source == source) ++counts[claim.verdict];
    }
  }
  return counts;
}

std::string counts_words(const Evaluation& evaluation, Source source) {
  std::string text;
  for (const auto& [verdict, count] : count_verdicts(evaluation, source)) {
    text += (text.empty() ? "" : ", ") + std::to_string(count) + " " + name_of(verdict);
  }
  return text.empty() ? "none" : text;
}

std::string machine_words(const Key& key) {
  return key.processor + ", " + std::to_string(key.num_cores) +
         (key.num_cores == 1 ? " core, " : " cores, ") + key.isa;
}

std::string form_words(const Evaluation& evaluation) {
  return evaluation.key.form + " form, " +
         (evaluation.commit.empty() ? "commit not told" : "commit " + evaluation.commit) + ", " +
         evaluation.finished + " UTC";
}

std::string report_page(const Evaluation& evaluation) {
  std::string html = open_page(
      "Evaluation",
      "Every figure of \u201cA Volume-Based Penetration Measure for 6DOF "
      "Haptic Rendering of Streaming Point Clouds\u201d, made again with this program, and "
      "what comes of each claim.",
      kEvaluationStyle);
  html += verdict_counts(evaluation) + facts(evaluation) + failures(evaluation);
  html += findings(evaluation);
  std::string links = "<nav>", tables, body;
  for (const Source source : kSources) {
    const std::string table = claim_table(evaluation, source);
    if (table.empty()) continue;
    tables += table;
    links += std::string("<a href='#all-") + name_of(source) + "'>" + heading_of(source) + "</a>";
  }
  for (const std::string& name : sections(evaluation)) {
    const std::string id = "s-" + file_stem(name);
    links += "<a href='#" + id + "'>" + escape_html(name) + "</a>";
    body += "<h2 id='" + id + "'>" + escape_html(name) + "</h2>\n";
    for (const ReportFigure& figure : evaluation.figures) {
      if (figure.stored && name == figure.spec.section) body += section_of(figure);
    }
  }
  html += links + "</nav>\n" + tables + not_made(evaluation) + body;
  return html + close_page(
                    "Times are of single calls on one thread: compare them within one report. "
                    "All else is the same on every machine.");
}

}  // namespace palpate::eval
