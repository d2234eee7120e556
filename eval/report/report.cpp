#include "eval/report/report.h"

#include <algorithm>
#include <nlohmann/json.hpp>

#include "palpate/version.h"
#include "src/pages/internal/pages.h"
#include "src/session/internal/compact_json.h"

namespace palpate::eval {
namespace {

using Json = nlohmann::ordered_json;

Json claims_json(const ReportFigure& figure) {
  Json json = Json::array();
  for (const auto& [where, claim] : claims_of(figure)) {
    json.push_back({{"source", name_of(claim.source)},
                    {"claim", claim.claim},
                    {"where", where},
                    {"measured", claim.measured},
                    {"verdict", name_of(claim.verdict)},
                    {"is_against", is_against(claim.verdict)}});
  }
  return json;
}

/// Serializes as in the file of the figure, but packs long lists of numbers.
Json stored_json(const StoredFigure& figure) {
  Json json = to_json(figure);
  for (std::size_t i = 0; i < figure.result.plots.size(); ++i) {
    const std::vector<Curve>& curves = figure.result.plots[i].curves;
    for (std::size_t k = 0; k < curves.size(); ++k) {
      Json& curve = json["plots"][i]["curves"][k];
      for (const auto& [name, values] :
           {std::pair("x", &curves[k].x), std::pair("y", &curves[k].y)}) {
        curve[name] = packed<float>(std::vector<float>(values->begin(), values->end()));
      }
    }
  }
  json["machine"] = machine_words(figure.key);
  return json;
}

Json figure_json(const ReportFigure& figure) {
  Json json{{"id", figure.spec.id},
            {"title", figure.spec.title},
            {"section", figure.spec.section},
            {"is_current", figure.is_current},
            {"data_file", std::string(kDataFolder) + "/" + file_stem(figure.spec.id) + ".json"},
            {"claims", Json::array()},
            {"stored", nullptr},
            {"on_gpu", nullptr}};
  if (!figure.stored) return json;
  json["claims"] = claims_json(figure);
  json["stored"] = stored_json(*figure.stored);
  if (figure.on_gpu) json["on_gpu"] = stored_json(*figure.on_gpu);
  return json;
}

std::string inputs_words(const Key& key) {
  return "real frames " + key.data +
         (key.gpu.empty() ? ", no times of a GPU" : ", times of a GPU") +
         (key.peers.empty() ? ", no times of other libraries" : ", times of other libraries");
}

}  // namespace

const char* heading_of(Source source) {
  switch (source) {
    case Source::thesis: return "Claims of the thesis";
    case Source::ours: return "Is Palpate better?";
    case Source::docs: return "Claims of our own";
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
  const auto& made = figure.stored->result.claims;
  for (const Claim& claim : figure.on_gpu->result.claims) {
    // Claims of an older program that this one does not make are dropped.
    if (std::ranges::find(made, claim.claim, &Claim::claim) == made.end()) continue;
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
         (evaluation.commit.empty() ? "commit not given" : "commit " + evaluation.commit) + ", " +
         evaluation.finished + " UTC";
}

Result<std::string> evaluation_page(const Evaluation& evaluation) {
  Json json{{"kind", "evaluation"},           {"program", PALPATE_VERSION},
            {"command", evaluation.command},  {"machine", machine_words(evaluation.key)},
            {"form", form_words(evaluation)}, {"inputs", inputs_words(evaluation.key)},
            {"sources", Json::array()},       {"figures", Json::array()}};
  for (const Source source : kSources) {
    Json counts = Json::array();
    for (const auto& [verdict, count] : count_verdicts(evaluation, source)) {
      counts.push_back({name_of(verdict), count});
    }
    json["sources"].push_back(
        {{"name", name_of(source)}, {"heading", heading_of(source)}, {"counts", counts}});
  }
  for (const ReportFigure& figure : evaluation.figures) {
    json["figures"].push_back(figure_json(figure));
  }
  return report_page("Palpate: Evaluation", page_text(json));
}

}  // namespace palpate::eval
