// options: cost of edge planes and of continuity.
#include <algorithm>
#include <cmath>
#include <iterator>

#include "eval/studies/pillar.h"
#include "eval/studies/speed.h"
#include "eval/studies/verdict_rules.h"

namespace palpate::eval {
namespace {

struct Choice {
  const char* name;
  Edges edges;
  Continuity continuity;
};
constexpr Choice kChoices[] = {
    {"no option", Edges::none, Continuity::none},
    {"--edges cut", Edges::cut, Continuity::none},
    {"--continuity entry", Edges::none, Continuity::entry},
    {"both options", Edges::cut, Continuity::entry},
};
constexpr std::size_t kEntry = 2;

/// Formats a time with two digits.
std::string rounded(double ms) {
  return words("%.*f", std::max(0, 1 - static_cast<int>(std::floor(std::log10(ms)))), ms);
}

/// A method with every choice of options; the field ignores them and has only the first.
struct MethodCost {
  std::string method;
  std::vector<Times> times;

  double median(std::size_t choice) const { return 1e3 * times[choice].median; }  ///< ms
};

Result<std::vector<MethodCost>> costs_of(Context& context, int num_spheres) {
  const auto frame = seen_pillar(context, true);
  if (!frame) return frame.error();
  const auto tool = pillar_box(context, num_spheres);
  if (!tool) return tool.error();
  auto query = query_on(*frame, **tool);
  const auto X_WT = pillar_way(PillarSide::right, context.choose(0.0002, 0.001));
  std::vector<MethodCost> costs;
  for (const Method& method : all_methods()) {
    const bool has_choice = method.options.method != MethodKind::field;
    MethodCost cost{method.name, {}};
    for (std::size_t c = 0; c < (has_choice ? std::size(kChoices) : 1); ++c) {
      ContactOptions options = method.options;
      options.edges = kChoices[c].edges;
      options.continuity = kChoices[c].continuity;
      cost.times.push_back(time_queries(*query, options, X_WT));
      context.progress(static_cast<double>(costs.size()) / 5);
    }
    costs.push_back(std::move(cost));
  }
  return costs;
}

Result<FigureResult> figure_options(Context& context) {
  const int num_spheres = context.choose(5000, 2000);
  const auto costs = costs_of(context, num_spheres);
  if (!costs) return costs.error();
  FigureResult result;
  Table table{"Median time of a query past an edge, ms", {"method"}, {}};
  for (const Choice& choice : kChoices) table.columns.emplace_back(choice.name);
  double weighted = 0, simplified = 0, most = 0;  // ms
  for (const MethodCost& cost : *costs) {
    std::vector<std::string> row{cost.method};
    for (std::size_t c = 0; c < cost.times.size(); ++c) {
      row.push_back(rounded(cost.median(c)));
      const std::string key = words("%s.%s.", cost.method.c_str(), kChoices[c].name);
      result.numbers.push_back({key + "median", cost.median(c), "ms"});
      result.numbers.push_back({key + "p99", 1e3 * cost.times[c].p99, "ms"});
      if (cost.method != "simplified") most = std::max(most, cost.median(c));
    }
    if (cost.method == "weighted") weighted = cost.median(kEntry);
    if (cost.method == "simplified") simplified = cost.median(kEntry);
    row.resize(table.columns.size());
    table.rows.push_back(std::move(row));
  }
  constexpr double kTick = 1;  // ms
  result.claims.push_back(
      {"With tools of thousands of spheres entry costs less with weighted than "
       "with simplified, which then looks at every donor for every sphere.",
       "Weighted " + rounded(weighted) + " ms, simplified " + rounded(simplified) + " ms.",
       holds_below(weighted, simplified), Source::docs});
  result.claims.push_back(
      {"Weighted and graph with any of these options, and the field, stay "
       "within a haptic tick.",
       "At most " + rounded(most) + " ms.", holds_below(most, kTick), Source::docs});
  result.tables.push_back(std::move(table));
  result.notes.push_back(
      words("A box of 8 cm with %d spheres leaves the pillar of the scene of that name to the "
            "right, as in figure edges; Kinect noise, one thread.",
            num_spheres));
  return result;
}

}  // namespace

std::vector<FigureSpec> option_speed() {
  return {{"options", "What edges and continuity cost", "Speed", figure_options}};
}

}  // namespace palpate::eval
