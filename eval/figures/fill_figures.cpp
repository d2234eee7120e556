// Fill of packings and their standoff from the surface, over the number of spheres.
#include <algorithm>
#include <array>
#include <cmath>
#include <iterator>

#include "eval/figures/option_figures.h"
#include "eval/studies/range.h"
#include "eval/studies/speed.h"
#include "eval/studies/verdict_rules.h"
#include "src/session/internal/packing_report.h"

namespace palpate::eval {
namespace {

constexpr double kSize = 0.1;  // m, the longest side
constexpr int kNumbers[] = {100, 300, 1000, 3000, 5000, 10000, 30000, 100000};
constexpr int kFirst = kNumbers[0];  // below this the power law does not hold
constexpr int kDefault = 5000;       // default of `palpate pack`
static_assert(std::ranges::find(kNumbers, kDefault) != std::end(kNumbers));

/// Shapes with ends that are thinner than most of their spheres, and how many of these.
constexpr const char* kThinShapes[] = {"finger", "comb", "needle", "blade"};
constexpr int kThinNumbers[] = {1000, 5000, 20000};

/// Claims of the documentation.
constexpr double kNearApollonian = 0.025;  // of the exponent
constexpr double kTimes = 30;              // as many spheres, for half the empty space
constexpr double kMinTimes = 25, kMaxTimes = 40;
constexpr double kRadiusExponent = 0.4, kNearRadiusExponent = 0.05;
constexpr double kMinFill = 0.8, kMaxFill = 0.9;  // of a tool packed by default

/// The packing of a shape, and its prefixes with as many spheres as `kNumbers` says.
struct Packing {
  std::string shape;
  std::vector<double> fill, smallest;  ///< [n - 1]: with the first n spheres; m, radius
  std::vector<double> standoff;        ///< m, mean, of the available prefixes
  PowerLaw early, late;                ///< of the empty share: the first decade, the last one
  PowerLaw radius;                     ///< of the smallest sphere, m

  double times_for_half() const { return std::pow(2, 1 / late.exponent); }
  double standoff_over_radius() const { return standoff.back() / smallest.back(); }
};

std::size_t at(int num_spheres) { return static_cast<std::size_t>(num_spheres) - 1; }

/// Packs a shape. `done` and `share` of the whole figure, for progress.
Result<Packing> pack(Context& context, const char* shape, int most, double done, double share) {
  const auto tool = context.tool(shape, kSize, most);
  if (!tool) return tool.error();
  Packing packing;
  packing.shape = shape;
  std::vector<double> empty;
  double volume = 0, smallest = INFINITY;
  for (const Sphere& sphere : (*tool)->spheres()) {
    const auto radius = static_cast<double>(sphere.radius);
    volume += sphere_volume(radius);
    smallest = std::min(smallest, radius);
    packing.fill.push_back(volume / (*tool)->mesh_mass().volume);
    packing.smallest.push_back(smallest);
    empty.push_back(1 - packing.fill.back());
  }
  const auto num = static_cast<int>(packing.fill.size());
  const Error too_few{Errc::bad_input, std::string("too few spheres fit into the ") + shape};
  if (num < 10 * kFirst) return too_few;
  for (const int n : kNumbers) {
    if (n > num) break;
    const auto prefix = (*tool)->prefix(n, context.settings().num_threads);
    if (!prefix) return prefix.error();
    packing.standoff.push_back(standoff(*prefix).mean);
    context.progress(done + share * n / most);
  }
  const auto early = fit_power_law(std::span(empty).first(at(10 * kFirst) + 1), kFirst);
  const auto late = fit_power_law(empty, num / 10);
  const auto radius = fit_power_law(packing.smallest, kFirst);
  if (!early || !late || !radius) return too_few;
  packing.early = *early, packing.late = *late, packing.radius = *radius;
  return packing;
}

/// Makes a table with a cell for every number of spheres; empty beyond the largest packing.
template <class Text>
Table table_over_numbers(const char* title, const std::vector<Packing>& packings, Text text) {
  Table table{title, {"shape"}, {}};
  for (const int n : kNumbers) table.columns.push_back(words("%d", n));
  for (const Packing& packing : packings) {
    std::vector<std::string> cells{packing.shape};
    for (std::size_t i = 0; i < std::size(kNumbers); ++i) {
      cells.push_back(i < packing.standoff.size() ? text(packing, i) : "");
    }
    table.rows.push_back(std::move(cells));
  }
  return table;
}

Table law_table(const std::vector<Packing>& packings) {
  Table table{"Power laws",
              {"shape", "exponent, first decade", "exponent, last decade",
               "times more spheres for half the empty space", "exponent of the smallest radius",
               "mean standoff / smallest radius"},
              {}};
  for (const Packing& p : packings) {
    table.rows.push_back({p.shape, words("%.3f", p.early.exponent), words("%.3f", p.late.exponent),
                          words("%.0f", p.times_for_half()), words("%.2f", p.radius.exponent),
                          words("%.2f", p.standoff_over_radius())});
  }
  return table;
}

Plot plot_of(const char* title, const char* y_label, const std::vector<Packing>& packings,
             double (*value)(const Packing&, std::size_t)) {
  Plot plot{title, "spheres", y_label, {}, true, true, ""};
  for (std::size_t k = 0; k < packings.size(); ++k) {
    Curve curve{packings[k].shape, words("other%zu", k % 4 + 1), {}, {}};
    for (std::size_t i = 0; i < packings[k].standoff.size(); ++i) {
      curve.x.push_back(kNumbers[i]);
      curve.y.push_back(value(packings[k], i));
    }
    plot.curves.push_back(std::move(curve));
  }
  return plot;
}

/// Returns the range of a value over the shapes.
template <class Value>
Range range(const std::vector<Packing>& packings, Value value) {
  Range range;
  for (const Packing& packing : packings) range.add(value(packing));
  return range;
}

void add_claims(FigureResult& result, const std::vector<Packing>& packings) {
  const auto law = range(packings, [](const Packing& p) { return p.late.exponent; });
  const auto times = range(packings, [](const Packing& p) { return p.times_for_half(); });
  const auto radius = range(packings, [](const Packing& p) { return p.radius.exponent; });
  const auto gap = range(packings, [](const Packing& p) { return p.standoff_over_radius(); });
  result.claims.push_back({words("The exponent of the empty "
                                 "share comes close to %.4f, that of the Apollonian packing.",
                                 kApollonianExponent),
                           words("%.3f to %.3f over the last decade up to %zu spheres.", law.low,
                                 law.high, packings.front().fill.size()),
                           holds_between(law, kApollonianExponent - kNearApollonian,
                                         kApollonianExponent + kNearApollonian),
                           Source::docs});
  result.claims.push_back({words("Half as much empty space "
                                 "takes about %.0f times as many spheres.",
                                 kTimes),
                           words("%.0f to %.0f times.", times.low, times.high),
                           holds_between(times, kMinTimes - 0.5, kMaxTimes + 0.5), Source::docs});
  result.claims.push_back(
      {words("The mean standoff is a bit more than half the "
             "smallest radius, which falls as N^-%.1f.",
             kRadiusExponent),
       words("%.2f to %.2f of the smallest radius, which falls as N^-%.2f to N^-%.2f.", gap.low,
             gap.high, radius.low, radius.high),
       holds_with({holds_between(gap, 0.5, 0.75),
                   holds_between(radius, kRadiusExponent - kNearRadiusExponent,
                                 kRadiusExponent + kNearRadiusExponent)}),
       Source::docs});
  const auto fill = range(packings, [](const Packing& p) { return p.fill[at(kDefault)]; });
  result.claims.push_back(
      {words("Spheres fill %.0f to %.0f %% of a tool.", 100 * kMinFill, 100 * kMaxFill),
       words("With %d, as they are packed by default, %.1f to %.1f %%.", kDefault, 100 * fill.low,
             100 * fill.high),
       holds_between(fill, kMinFill, kMaxFill), Source::docs});
}

void add_numbers(FigureResult& result, const std::vector<Packing>& packings) {
  for (const Packing& p : packings) {
    const auto add = [&](const std::string& key, double value, const char* unit) {
      result.numbers.push_back({p.shape + "." + key, value, unit});
    };
    for (std::size_t i = 0; i < p.standoff.size(); ++i) {
      add(words("fill.%d", kNumbers[i]), 100 * p.fill[at(kNumbers[i])], "%");
      add(words("standoff.%d", kNumbers[i]), 1e3 * p.standoff[i], "mm");
    }
    add("exponent.early", p.early.exponent, "1");
    add("exponent.late", p.late.exponent, "1");
    add("times_for_half", p.times_for_half(), "1");
    add("radius_exponent", p.radius.exponent, "1");
    add("standoff_over_radius", p.standoff_over_radius(), "1");
  }
}

/// Adds the standoff of thin ends, and verifies the bound that the packing promises.
Status add_thin_ends(Context& context, FigureResult& result) {
  Table table{"Standoff of tools of 10 cm that are thin at one end, mm", {"shape"}, {}};
  const int most = context.choose(kThinNumbers[std::size(kThinNumbers) - 1], kDefault);
  Range share_of_bound;
  for (const int n : kThinNumbers) {
    table.columns.push_back(words("%d: 95 %%", n));
    table.columns.push_back(words("%d: largest", n));
  }
  for (const char* shape : kThinShapes) {
    const auto tool = context.tool(shape, kSize, most);
    if (!tool) return tool.error();
    std::vector<std::string> cells{shape};
    for (const int n : kThinNumbers) {
      if (n > most) {  // empty beyond the largest packing, as in the tables above
        cells.resize(cells.size() + 2);
        continue;
      }
      const auto prefix = (*tool)->prefix(n, context.settings().num_threads);
      if (!prefix) return prefix.error();
      const Standoff gap = standoff(*prefix);
      cells.push_back(words("%.3f", 1e3 * gap.p95));
      cells.push_back(words("%.2f", 1e3 * gap.max));
      result.numbers.push_back({words("%s.p95.%d", shape, n), 1e3 * gap.p95, "mm"});
      result.numbers.push_back({words("%s.largest.%d", shape, n), 1e3 * gap.max, "mm"});
      share_of_bound.add(gap.max / standoff_bound(gap.p95, kSize));
    }
    table.rows.push_back(std::move(cells));
  }
  result.tables.push_back(std::move(table));
  result.claims.push_back(
      {"Thin ends have contact: no standoff exceeds 4 times that of 95 % of the surface, or 1 % of "
       "the tool's length if that is more.",
       words("The largest are %.2f to %.2f of that bound.", share_of_bound.low,
             share_of_bound.high),
       holds_up_to(share_of_bound.high, 1), Source::docs});
  return Done{};
}

}  // namespace

Result<FigureResult> figure_fill(Context& context) {
  const auto shapes = context.choose<std::vector<const char*>>(
      {"box", "octahedron", "tetrahedron", "cylinder", "torus", "stylus", "spiral"},
      {"box", "torus", "stylus"});
  const int most = context.choose(kNumbers[std::size(kNumbers) - 1], kDefault);
  std::vector<Packing> packings;
  const double share = 1 / static_cast<double>(shapes.size());
  for (const char* shape : shapes) {
    auto packing = pack(context, shape, most, share * static_cast<double>(packings.size()), share);
    if (!packing) return packing.error();
    packings.push_back(*std::move(packing));
  }
  FigureResult result;
  add_claims(result, packings);
  result.tables = {
      table_over_numbers("Filled share of the mesh over the number of spheres, %", packings,
                         [](const Packing& p, std::size_t i) {
                           return words("%.1f", 100 * p.fill[at(kNumbers[i])]);
                         }),
      table_over_numbers(
          "Mean standoff of a tool of 10 cm, mm", packings,
          [](const Packing& p, std::size_t i) { return words("%.3f", 1e3 * p.standoff[i]); }),
      law_table(packings)};
  if (const Status status = add_thin_ends(context, result); !status) return status.error();
  Plot empty =
      plot_of("Empty space", "empty share of the mesh, %", packings,
              [](const Packing& p, std::size_t i) { return 100 * (1 - p.fill[at(kNumbers[i])]); });
  const auto times = range(packings, [](const Packing& p) { return p.times_for_half(); });
  empty.caption = words("Power laws: half as much takes %.0f to %.0f times as many spheres.",
                        times.low, times.high);
  Plot late = plot_of("Delay of the contact: mean standoff", "mean standoff, mm", packings,
                      [](const Packing& p, std::size_t i) { return 1e3 * p.standoff[i]; });
  const auto gap = range(packings, [](const Packing& p) { return p.standoff_over_radius(); });
  late.caption = words("In the end it is %.2f to %.2f of the smallest radius.", gap.low, gap.high);
  result.plots = {std::move(empty), std::move(late)};
  add_numbers(result, packings);
  result.notes = {words("Shapes of `palpate shape`, the longest side %g cm. Standoff: distance "
                        "from points of the mesh's surface to the nearest sphere.",
                        100 * kSize),
                  words("Exponents: least squares, every part of a decade with the same weight; of "
                        "the radius from %d spheres on; the ratio at the end.",
                        kFirst)};
  return result;
}

}  // namespace palpate::eval
