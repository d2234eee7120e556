// graphs: packings that favor the graph (thesis sections 3.3.1, 5.0.1 and 6 leave it open): largest
// radius and gap rule, by the properties of the graph: neighbors of a sphere, ways across.
#include <algorithm>
#include <cmath>
#include <queue>

#include "eval/figures/option_figures.h"
#include "eval/studies/interaction.h"
#include "eval/studies/speed.h"
#include "eval/studies/verdict_rules.h"
#include "palpate/mesh/mesh.h"
#include "palpate/packing/packing.h"

namespace palpate::eval {
namespace {

constexpr double kSize = 0.12;                       // m
constexpr double kRadii[] = {1, 0.06, 0.03, 0.015};  // largest radius, of the longest side
constexpr double kFew = 1.1;                         // times

struct Packing {
  double radius = 0;  ///< m
  GapRule rule = GapRule::relative;
  double fill = 0;    ///< share of the mesh
  double degree = 0;  ///< neighbors of a sphere, mean
  int across = 0;     ///< edges between the two spheres that are farthest apart, lower bound
  Times weighted, simplified, graph;
  double jump = 0;  ///< largest step of the graph's force along the way, % of the whole

  double ratio() const { return graph.median / simplified.median; }
  std::string name() const {
    return words("largest radius %s, gap rule %s",
                 radius < kSize ? words("%.1f mm", 1e3 * radius).c_str() : "free",
                 name_of(rule).c_str());
  }
};

/// Returns the sphere farthest from `from` in the graph, and its distance in edges.
std::pair<std::size_t, int> farthest(const LeafGraph& graph, std::size_t from) {
  const std::size_t n = graph.row_starts().size() - 1;
  std::vector<int> rounds(n, -1);
  std::queue<std::size_t> open;
  open.push(from);
  rounds[from] = 0;
  std::size_t last = from;
  while (!open.empty()) {
    last = open.front();
    open.pop();
    for (auto e = graph.row_starts()[last]; e < graph.row_starts()[last + 1]; ++e) {
      const auto j = static_cast<std::size_t>(graph.neighbors()[static_cast<std::size_t>(e)]);
      if (rounds[j] >= 0) continue;
      rounds[j] = rounds[last] + 1;
      open.push(j);
    }
  }
  return {last, rounds[last]};
}

double correlation(const std::vector<double>& x, const std::vector<double>& y) {
  const auto n = static_cast<double>(x.size());
  double mx = 0, my = 0, xy = 0, xx = 0, yy = 0;
  for (std::size_t i = 0; i < x.size(); ++i) mx += x[i] / n, my += y[i] / n;
  for (std::size_t i = 0; i < x.size(); ++i) {
    xy += (x[i] - mx) * (y[i] - my);
    xx += (x[i] - mx) * (x[i] - mx), yy += (y[i] - my) * (y[i] - my);
  }
  return xy / std::sqrt(xx * yy);
}

Result<std::vector<Packing>> measure(Context& context) {
  const auto scene = simulated_interaction(context);
  if (!scene) return scene.error();
  const auto mesh = make_shape(scene->shape, kSize);
  if (!mesh) return mesh.error();
  std::vector<Packing> packings;
  for (const double radius : kRadii) {
    PackOptions options;
    options.max_spheres = context.choose(5000, 800);
    options.max_radius = radius * kSize;
    options.num_threads = context.settings().num_threads;
    const auto spheres = pack_spheres(*mesh, options);
    if (!spheres) return spheres.error();
    for (const GapRule rule : {GapRule::relative, GapRule::absolute}) {
      const auto tool = Tool::build(*mesh, *spheres, {rule, scene->shape, options.num_threads});
      if (!tool) return tool.error();
      Packing p{options.max_radius, rule, {}, {}, {}, {}, {}, {}, {}};
      p.fill = tool->sphere_mass().volume / tool->mesh_mass().volume;
      p.degree = 2.0 * tool->graph().num_edges() / static_cast<double>(tool->spheres().size());
      p.across = farthest(tool->graph(), farthest(tool->graph(), 0).first).second;
      const auto path = hand_path(scene->frame, *tool, 0.1, context.choose<std::size_t>(1000, 100));
      if (!path) return path.error();
      auto query = query_on(scene->frame, *tool);
      const auto time = [&](MethodKind method) {
        return time_queries(*query, {.method = method}, path->X_WT);
      };
      p.weighted = time(MethodKind::weighted);
      p.simplified = time(MethodKind::simplified);
      p.graph = time(MethodKind::graph);
      const double whole = tool->sphere_mass().volume;
      Vec3d before;
      for (std::size_t i = 0; i < path->X_WT.size(); ++i) {
        const Vec3d force =
            query->query(path->X_WT[i], {.method = MethodKind::graph}).measure_W.force / whole;
        if (i > 0) p.jump = std::max(p.jump, 100 * norm(force - before));
        before = force;
      }
      packings.push_back(std::move(p));
      context.progress(static_cast<double>(packings.size()) / (2 * std::size(kRadii)));
    }
  }
  return packings;
}

}  // namespace

Result<FigureResult> figure_graphs(Context& context) {
  const auto packings = measure(context);
  if (!packings) return packings.error();
  FigureResult result;
  Table table{
      "Packings and what the graph makes of them, 10 % deep",
      {"largest radius, mm", "gap rule", "filled, %", "neighbors", "edges across", "weighted, µs",
       "simplified, µs", "graph, µs", "graph / simplified", "largest step of the graph, %"},
      {}};
  Plot plot{"Which packings favor the graph",
            "neighbors of a sphere",
            "time, simplified = 1",
            {},
            false,
            false,
            ""};
  const char* styles[] = {"graph", "graph-cap"};
  std::vector<double> degrees, ways, ratios, times;
  for (const GapRule rule : {GapRule::relative, GapRule::absolute}) {
    Curve curve{"graph, gap rule " + name_of(rule), styles[rule == GapRule::absolute], {}, {}};
    for (const Packing& p : *packings) {
      if (p.rule != rule) continue;
      curve.x.push_back(p.degree), curve.y.push_back(p.ratio());
    }
    plot.curves.push_back(std::move(curve));
  }
  for (const Packing& p : *packings) {
    const std::string radius = p.radius < kSize ? words("%.1f", 1e3 * p.radius) : "free";
    table.rows.push_back({radius, name_of(p.rule), words("%.0f", 100 * p.fill),
                          words("%.1f", p.degree), words("%d", p.across),
                          time_words(1e6 * p.weighted.median),
                          time_words(1e6 * p.simplified.median), time_words(1e6 * p.graph.median),
                          words("%.2f", p.ratio()), words("%.1f", p.jump)});
    const std::string key = radius + "." + name_of(p.rule) + ".";
    result.numbers.push_back({key + "degree", p.degree, "1"});
    result.numbers.push_back({key + "across", static_cast<double>(p.across), "edges"});
    result.numbers.push_back({key + "graph", 1e6 * p.graph.median, "µs"});
    result.numbers.push_back({key + "simplified", 1e6 * p.simplified.median, "µs"});
    result.numbers.push_back({key + "weighted", 1e6 * p.weighted.median, "µs"});
    result.numbers.push_back({key + "jump", p.jump, "%"});
    degrees.push_back(p.degree), ways.push_back(p.across), ratios.push_back(p.ratio());
    times.push_back(p.graph.median);
  }
  const auto by_ratio = [](const Packing& a, const Packing& b) { return a.ratio() < b.ratio(); };
  const Packing& best = *std::min_element(packings->begin(), packings->end(), by_ratio);
  const Packing& worst = *std::max_element(packings->begin(), packings->end(), by_ratio);
  plot.caption = words(
      "The graph takes %.2f times as long as simplified at best (%s), %.2f times at "
      "worst (%s).",
      best.ratio(), best.name().c_str(), worst.ratio(), worst.name().c_str());
  const auto fastest = [&](Times Packing::*of_method) {
    double least = INFINITY;
    for (const Packing& p : *packings) least = std::min(least, 1e6 * (p.*of_method).median);
    return least;
  };
  const Packing& plain = packings->front();
  result.claims.push_back(
      {"Without large spheres the graph is faster than simplified, and calmer than with them, 10 % "
       "deep.",
       words(
           "%s: %.2f times as long as simplified, largest step %.1f %%; largest radius free: %.2f "
           "times, %.1f %%. Each with its best packing: graph %.0f µs, simplified %.0f.",
           best.name().c_str(), best.ratio(), best.jump, plain.ratio(), plain.jump,
           fastest(&Packing::graph), fastest(&Packing::simplified)),
       holds_with({holds_below(best.ratio() * kFew, 1), holds_below(best.radius, plain.radius),
                   holds_below(best.jump, plain.jump)}),
       Source::docs});
  const double by_degree = correlation(degrees, times), by_ways = correlation(ways, times);
  result.claims.push_back(
      {"The graph is the slower the more neighbors a sphere has, and the more edges it is across "
       "the tool.",
       words("Correlation of its time with the neighbors %.2f, with the edges across %.2f.",
             by_degree, by_ways),
       holds_with({holds_above(by_degree, 0.5), holds_above(by_ways, 0.5)}), Source::docs});
  result.plots.push_back(std::move(plot));
  result.tables.push_back(std::move(table));
  result.notes.push_back(words(
      "A torus of 12 cm with %d spheres on the simulated mannequin, times of one CPU core. Edges "
      "across: a lower bound of the graph's diameter, by two searches.",
      context.choose(5000, 800)));
  return result;
}

}  // namespace palpate::eval
