// continuity, and the list of the studies of options, which compare forces and volumes.
#include "eval/figures/option_figures.h"

#include <algorithm>
#include <cmath>
#include <iterator>
#include <limits>
#include <string_view>

#include "eval/studies/force_steps.h"
#include "eval/studies/speed.h"
#include "eval/studies/verdict_rules.h"

namespace palpate::eval {
namespace {

constexpr const char* kContinuityNames[] = {"none", "kernel", "entry", "both"};
constexpr std::size_t kNumContinuities = std::size(kContinuityNames);
constexpr auto kEntry = static_cast<std::size_t>(Continuity::entry);
constexpr auto kKernel = static_cast<std::size_t>(Continuity::kernel);

/// Force steps for every value of `Continuity` where a method measures the cube in a solid. Methods
/// without that option have only the first.
struct Sinking {
  std::string solid, method;
  std::vector<std::vector<double>> steps;  ///< of the force, shares of the tool

  double largest(std::size_t continuity) const { return std::ranges::max(steps[continuity]); }
};

/// Measures in all ways against one solid, the exact one first.
Result<std::vector<Sinking>> sink(Context& context, const NoisySolid& solid, double done) {
  const auto cube = sinking_cube(context);
  if (!cube) return cube.error();
  const Tool& tool = **cube;
  const RenderedScene seen = see_noisy(solid);
  const Measure exact = exact_measure(tool, solid.environment);
  std::vector<Sinking> all{{solid.name, "exact", {force_steps(exact)}}};
  for (const Method& method : all_methods_alike()) {
    const bool has_choice = method.options.method != MethodKind::field;
    Sinking sinking{solid.name, method.name, {}};
    for (std::size_t c = 0; c < (has_choice ? kNumContinuities : 1); ++c) {
      ContactOptions options = method.options;
      options.continuity = static_cast<Continuity>(c);
      sinking.steps.push_back(force_steps(query_measure(tool, seen, options)));
      context.progress(done);
    }
    all.push_back(std::move(sinking));
  }
  return all;
}

Table table_of(const std::vector<Sinking>& all) {
  Table table{words("Largest change of the force over %.2f mm, %% of the tool's volume",
                    1e3 * kSinkingStep),
              {"scene", "method", "none", "kernel", "entry", "both"},
              {}};
  for (const Sinking& sinking : all) {
    std::vector<std::string> row{sinking.solid, sinking.method};
    for (std::size_t c = 0; c < sinking.steps.size(); ++c) {
      row.push_back(words("%.2f", 100 * sinking.largest(c)));
    }
    row.resize(table.columns.size());
    table.rows.push_back(std::move(row));
  }
  return table;
}

using Names = std::vector<std::string_view>;

/// Range of the ratio of two steps, over some methods and all solids.
struct Range {
  double low = std::numeric_limits<double>::infinity(), high = 0;

  void add(double times) { low = std::min(low, times), high = std::max(high, times); }
};
struct Comparison {
  Range to_exact, to_none;  ///< largest step over the exact one, and over that without the option
};
Comparison compare(const std::vector<Sinking>& all, Names methods, std::size_t continuity) {
  Comparison comparison;
  double exact = 0;  // of the current solid: its first way is the exact one
  for (const Sinking& sinking : all) {
    if (sinking.method == "exact") exact = sinking.largest(0);
    if (std::ranges::find(methods, sinking.method) == methods.end()) continue;
    comparison.to_exact.add(sinking.largest(continuity) / exact);
    comparison.to_none.add(sinking.largest(continuity) / sinking.largest(0));
  }
  return comparison;
}

/// Plots the steps of one method along the way into one solid.
Plot plot_of(const std::vector<Sinking>& all, const std::string& solid, const std::string& method) {
  Plot plot{words("%s, cube into a %s", method.c_str(), solid.c_str()),
            "way of the cube, mm",
            "change of the force, % of the tool",
            {},
            false,
            false,
            ""};
  const auto add = [&](const std::string& label, const std::string& style,
                       const std::vector<double>& steps) {
    Curve curve{label, style, {}, {}};
    for (std::size_t k = 0; k < steps.size(); ++k) {
      curve.x.push_back(1e3 * kSinkingStep * static_cast<double>(k));
      curve.y.push_back(100 * steps[k]);
    }
    plot.curves.push_back(std::move(curve));
  };
  double exact = 0;
  for (const Sinking& sinking : all) {
    if (sinking.solid != solid) continue;
    if (sinking.method == "exact") {
      exact = sinking.largest(0);
      add("exact", "exact", sinking.steps[0]);
    }
    if (sinking.method != method) continue;
    add("no option", method, sinking.steps[0]);
    add("entry", "other2", sinking.steps[kEntry]);
    plot.caption = words(
        "Points that enter and leave change the force by up to %.2f %% at a tick, with entry by "
        "%.2f %%; the exact force changes by %.2f %%.",
        100 * sinking.largest(0), 100 * sinking.largest(kEntry), 100 * exact);
  }
  return plot;
}

void add_claims(FigureResult& result, const std::vector<Sinking>& all) {
  constexpr double kSmooth = 1.5;  // times the exact step: no jump
  const Names averages{"weighted", "simplified"};
  const double without = compare(all, averages, 0).to_exact.high;
  const double entry = compare(all, averages, kEntry).to_exact.high;
  result.claims.push_back(
      {"Boundary spheres that fade in with their points (entry) take all jumps "
       "from weighted and simplified.",
       words("Largest step with entry at most %.1f times the exact one, without up to %.1f times.",
             entry, without),
       holds_below(entry, kSmooth, without), Source::docs});
  const Range kernel = compare(all, averages, kKernel).to_none;
  result.claims.push_back(
      {"Kernel weights alone make things worse.",
       words("Largest step of weighted and simplified with kernel %.1f to %.1f times that without.",
             kernel.low, kernel.high),
       holds_with({holds_above(kernel.low, 0.9), holds_above(kernel.high, 1.1)}), Source::docs});
  const double full = compare(all, {"graph"}, kEntry).to_exact.high;
  const double capped = compare(all, {"graph-cap"}, kEntry).to_exact.high;
  result.claims.push_back(
      {"The jumps of whole spheres that come and go remain; the graph needs "
       "caps first.",
       words("Graph with entry up to %.0f times the exact step, capped %.0f times.", full, capped),
       holds_with({holds_above(full, kSmooth), holds_below(capped, full / 5)}), Source::docs});
  const double field = compare(all, {"field"}, 0).to_exact.high;
  result.claims.push_back({"The field is smooth without any option.",
                           words("At most %.2f times the exact step.", field),
                           holds_below(field, kSmooth), Source::docs});
}

Result<FigureResult> figure_continuity(Context& context) {
  std::vector<Sinking> all;
  const auto solids = noisy_solids();
  for (std::size_t i = 0; i < solids.size(); ++i) {
    auto sunk =
        sink(context, solids[i], static_cast<double>(i) / static_cast<double>(solids.size()));
    if (!sunk) return sunk.error();
    std::ranges::move(*sunk, std::back_inserter(all));
  }
  FigureResult result;
  add_claims(result, all);
  result.tables.push_back(table_of(all));
  for (const Sinking& sinking : all) {
    for (std::size_t c = 0; c < sinking.steps.size(); ++c) {
      result.numbers.push_back(
          {words("%s.%s.%s", sinking.solid.c_str(), sinking.method.c_str(), kContinuityNames[c]),
           100 * sinking.largest(c), "%"});
    }
  }
  result.plots.push_back(plot_of(all, "ball", "weighted"));
  result.notes.push_back(
      "A cube of 6 cm with 500 spheres, tilted by 20 degrees, sinks 3 cm into a wall and into a "
      "ball of 8 cm radius; depth noise 1.5 mm.");
  return result;
}

}  // namespace

std::vector<FigureSpec> option_figures() {
  return {
      {"continuity", "Points that enter and leave a sphere", "Quality", figure_continuity},
      {"bodies", "Two packings that overlap", "Quality", figure_bodies},
      {"fill", "How full a packing is", "Quality", figure_fill},
      {"graphs", "Which packings favor the graph", "Speed", figure_graphs},
      {"eighth", "Stiffness: the largest force at an eighth of the tool", "Quality", figure_eighth},
      {"corners", "Two edges at once, and a corner", "Time and edges", figure_corners},
      {"others", "What else one would use", "Peers", figure_others},
      {"priorities", "What makes a boundary sphere a good donor", "Quality", figure_priorities},
  };
}

}  // namespace palpate::eval
