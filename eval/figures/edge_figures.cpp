// 3.12-3.14 and edges: depth edges, where the visible surface ends (thesis section 3.5).
#include <algorithm>
#include <cmath>
#include <iterator>

#include "eval/studies/interaction.h"
#include "eval/studies/pillar.h"
#include "eval/studies/speed.h"
#include "eval/studies/verdict_rules.h"

namespace palpate::eval {
namespace {

constexpr int kSpheres = 1500;
constexpr double kStopped = 0.5;  // of the error without edge planes

double step_of_way(const Context& context) { return context.choose(0.00025, 0.001); }  // m

const char* camera_name(bool with_noise) { return with_noise ? "noise" : "noise-free"; }

/// Depth-change vectors at both sides of the pillar: they should point away from it.
Result<FigureResult> figure_3_12(Context& context) {
  FigureResult result;
  Table table{
      "Depth-change vectors along the pillar", {"camera", "side", "vectors", "outward, %"}, {}};
  double least = 1;
  int num_sides = 0;  // sides with vectors, of 4
  for (const bool with_noise : {false, true}) {
    const auto frame = seen_pillar(context, with_noise);
    if (!frame) return frame.error();
    const PointCloudView cloud = frame->cloud();
    int num[2] = {}, outward[2] = {};
    for (std::size_t i = 0; i < cloud.size(); ++i) {
      const Vec3d edge = to_double(Vec3f{cloud.edge_x[i], cloud.edge_y[i], cloud.edge_z[i]});
      const double x = static_cast<double>(cloud.x[i]), z = static_cast<double>(cloud.z[i]);
      const bool is_pillar = std::abs(z - 1) < 0.03 && std::abs(std::abs(x) - kPillarEdge) < 0.01;
      if (!is_pillar || norm(edge) < 0.005) continue;
      const int side = x > 0;
      ++num[side];
      outward[side] += edge.x * x > 0;
    }
    for (int side = 0; side < 2; ++side) {
      const double share = num[side] ? static_cast<double>(outward[side]) / num[side] : 0;
      table.rows.push_back({with_noise ? "Kinect noise" : "no noise", side ? "right" : "left",
                            words("%d", num[side]), words("%.1f", 100 * share)});
      result.numbers.push_back(
          {words("%s.%s.outward", with_noise ? "noisy" : "clean", side ? "right" : "left"),
           100 * share, "%"});
      if (!with_noise) least = std::min(least, share);  // a side without vectors has none outward
      num_sides += num[side] > 0;
    }
  }
  result.claims.push_back(
      {"Depth-change vectors point outward at both sides of a pillar.",
       words("Without noise at least %.1f %% of them at each side; with the "
             "noise and the shadow of a Kinect %s.",
             100 * least,
             num_sides == 4 ? "both sides have vectors, too" : "a side in the shadow has none"),
       are_true({least > 0.95, num_sides == 4})});
  result.notes.push_back(
      "Left of the pillar the Kinect's projector throws a shadow: where nothing is "
      "measured beside an edge there is no vector; the methods find that edge by "
      "the missing pixels.");
  result.tables.push_back(std::move(table));
  return result;
}

/// Plots the volumes along a way: shares of the tool over the position of the box.
Curve curve_of(const std::string& label, const std::string& style, const std::vector<Pose>& X_WT,
               const std::vector<double>& volumes) {
  Curve curve{label, style, {}, {}};
  for (std::size_t i = 0; i < X_WT.size(); ++i) {
    curve.x.push_back(1e3 * std::abs(X_WT[i].translation.x));
    curve.y.push_back(100 * volumes[i]);
  }
  return curve;
}

Plot plot_of_ways(const std::string& title) {
  return {title, "|x| of the box, mm", "volume, % of the box", {}, false, false, ""};
}

Result<FigureResult> figure_3_14(Context& context) {
  const auto tool = pillar_box(context, kSpheres, GapRule::absolute);
  if (!tool) return tool.error();
  const auto frame = seen_pillar(context, false);
  if (!frame) return frame.error();
  auto query = query_on(*frame, **tool);
  FigureResult result;
  Plot plot = plot_of_ways("A box leaves a pillar to the side");
  Table table{"Error of the volume, % of the box", {"method", "edges", "rms", "worst"}, {}};
  const auto X_WT = pillar_way(PillarSide::right, step_of_way(context));
  const auto exact = exact_volumes(**tool, PillarSide::right, X_WT);
  plot.curves.push_back(curve_of("exact", "exact", X_WT, exact));
  struct Try {
    const char* name;
    MethodKind method;
    Edges edges;
    const char *words, *style;
  };
  const Try tries[] = {{"graph", MethodKind::graph, Edges::none, "none", "graph"},
                       {"graph", MethodKind::graph, Edges::strict, "strict", "other1"},
                       {"graph", MethodKind::graph, Edges::cut, "cut", "other2"},
                       {"simplified", MethodKind::simplified, Edges::none, "none", "simplified"},
                       {"simplified", MethodKind::simplified, Edges::cut, "cut", "other3"},
                       {"field", MethodKind::field, Edges::none, "of its own", "field"}};
  double worst_none = 0, worst_strict = 0, worst_cut = 0, worst_field = 0;
  for (const Try& t : tries) {
    ContactOptions options;
    options.method = t.method;
    options.edges = t.edges;
    options.volumes = SphereVolumes::represented;
    const auto volumes = measured_volumes(*query, **tool, X_WT, options);
    const WayError error = way_error(volumes, exact);
    const double worst = 100 * error.worst;
    plot.curves.push_back(
        curve_of(words("%s, edges: %s", t.name, t.words), t.style, X_WT, volumes));
    table.rows.push_back({t.name, t.words, words("%.2f", 100 * error.rms), words("%.2f", worst)});
    result.numbers.push_back({words("%s.%s.worst", t.name, t.words), worst, "%"});
    if (t.method == MethodKind::graph && t.edges == Edges::none) worst_none = worst;
    if (t.method == MethodKind::graph && t.edges == Edges::strict) worst_strict = worst;
    if (t.method == MethodKind::graph && t.edges == Edges::cut) worst_cut = worst;
    if (t.method == MethodKind::field) worst_field = worst;
  }
  plot.caption = words(
      "Without edge planes the graph is wrong by up to %.0f %% of the box, cut by them "
      "by %.1f %%; the field by %.1f %%.",
      worst_none, worst_cut, worst_field);
  result.claims.push_back({"An edge plane stops the flood that tunnels past the edge.",
                           words("Worst error of the graph: %.0f %% of the box without, %.1f %% "
                                 "with edge planes (strict), "
                                 "%.1f %% if they cut spheres.",
                                 worst_none, worst_strict, worst_cut),
                           is_less(worst_strict, kStopped * worst_none)});
  result.claims.push_back(
      {"The field, and planes that cut spheres, are nearer to the truth than edge planes as "
       "printed.",
       words("Worst error of the field %.1f %% of the box, of the graph with cut spheres %.1f %%, "
             "as printed %.1f %%.",
             worst_field, worst_cut, worst_strict),
       is_better_in_all({is_better(worst_field, worst_strict), is_better(worst_cut, worst_strict)}),
       Source::ours});
  result.plots.push_back(std::move(plot));
  result.tables.push_back(std::move(table));
  return result;
}

constexpr const char* kEdgeNames[] = {"none", "center", "strict", "cut"};
constexpr std::size_t kNumEdges = std::size(kEdgeNames);
constexpr auto kStrict = static_cast<std::size_t>(Edges::strict);
constexpr auto kCut = static_cast<std::size_t>(Edges::cut);

/// Volumes of a method along a way, for each value of `Edges`; the field ignores them and has only
/// the first.
struct MethodOnWay {
  Method method;
  std::vector<std::vector<double>> volumes;
  std::vector<WayError> errors;

  bool is_field() const { return method.options.method == MethodKind::field; }
};

/// One camera at one side of the pillar.
struct WayPastEdge {
  bool with_noise = false;
  PillarSide side = PillarSide::right;
  std::vector<Pose> X_WT;
  std::vector<double> exact;
  std::vector<MethodOnWay> methods;
};

Result<WayPastEdge> way_past_edge(Context& context, const FrozenFrame& frame, bool with_noise,
                                  PillarSide side, double done) {
  const auto tool = pillar_box(context, kSpheres);
  if (!tool) return tool.error();
  auto query = query_on(frame, **tool);
  WayPastEdge way{with_noise, side, pillar_way(side, step_of_way(context)), {}, {}};
  way.exact = exact_volumes(**tool, side, way.X_WT);
  for (const Method& method : all_methods()) {
    MethodOnWay on_way{method, {}, {}};
    ContactOptions options = method.options;
    options.volumes = SphereVolumes::represented;
    for (std::size_t e = 0; e < (on_way.is_field() ? 1 : kNumEdges); ++e) {
      options.edges = static_cast<Edges>(e);
      on_way.volumes.push_back(measured_volumes(*query, **tool, way.X_WT, options));
      on_way.errors.push_back(way_error(on_way.volumes.back(), way.exact));
      context.progress(done);
    }
    way.methods.push_back(std::move(on_way));
  }
  return way;
}

Table table_of(const std::vector<WayPastEdge>& ways) {
  Table table{"Volume past an edge, rms error / largest step, % of the tool",
              {"method", "camera", "side", "none", "center", "strict", "cut"},
              {}};
  for (std::size_t m = 0; m < ways.front().methods.size(); ++m) {
    for (const WayPastEdge& way : ways) {
      const MethodOnWay& on_way = way.methods[m];
      std::vector<std::string> row{on_way.method.name, camera_name(way.with_noise),
                                   name_of(way.side)};
      for (const WayError& error : on_way.errors) {
        row.push_back(words("%.1f / %.1f", 100 * error.rms, 100 * error.largest_step));
      }
      row.resize(table.columns.size());
      table.rows.push_back(std::move(row));
    }
  }
  return table;
}

void add_numbers(FigureResult& result, const WayPastEdge& way) {
  for (const MethodOnWay& on_way : way.methods) {
    for (std::size_t e = 0; e < on_way.errors.size(); ++e) {
      const WayError& error = on_way.errors[e];
      const std::string key = words("%s.%s.%s.%s.", on_way.method.name, camera_name(way.with_noise),
                                    name_of(way.side), kEdgeNames[e]);
      result.numbers.push_back({key + "rms", 100 * error.rms, "%"});
      result.numbers.push_back({key + "worst", 100 * error.worst, "%"});
      result.numbers.push_back({key + "step", 100 * error.largest_step, "%"});
    }
  }
}

Plot plot_of(const WayPastEdge& way) {
  constexpr const char* kStyles[] = {"graph-cap", "other1", "other2", "other3"};
  Plot plot = plot_of_ways("graph-cap and field, noise, into the shadow of the projector");
  plot.curves.push_back(curve_of("exact", "exact", way.X_WT, way.exact));
  double none = 0, strict = 0, cut = 0, field = 0;
  for (const MethodOnWay& on_way : way.methods) {
    if (on_way.is_field()) {
      plot.curves.push_back(curve_of("field", "field", way.X_WT, on_way.volumes[0]));
      field = on_way.errors[0].worst;
    }
    if (on_way.method.options.inside != InsideVolume::cap) continue;
    for (std::size_t e = 0; e < kNumEdges; ++e) {
      plot.curves.push_back(
          curve_of(words("edges: %s", kEdgeNames[e]), kStyles[e], way.X_WT, on_way.volumes[e]));
    }
    none = on_way.errors[0].worst;
    strict = on_way.errors[kStrict].worst;
    cut = on_way.errors[kCut].worst;
  }
  plot.caption = words(
      "Worst error of the graph, %% of the box: %.0f without edge planes, %.0f with strict ones, "
      "%.1f cut by them; of the field %.1f.",
      100 * none, 100 * strict, 100 * cut, 100 * field);
  return plot;
}

/// The extremes over methods, cameras and sides: shares of the tool.
struct EdgeExtremes {
  double cut_rms = 0, cut_step = 0;          // the largest
  double other_rms = 1, other_step = 1;      // the smallest of none, center and strict
  double field_rms[2] = {}, field_step = 0;  // the largest; [with noise]
};
EdgeExtremes extremes_of(const std::vector<WayPastEdge>& ways) {
  EdgeExtremes x;
  for (const WayPastEdge& way : ways) {
    for (const MethodOnWay& on_way : way.methods) {
      for (std::size_t e = 0; e < on_way.errors.size(); ++e) {
        const WayError& error = on_way.errors[e];
        if (on_way.is_field()) {
          x.field_rms[way.with_noise] = std::max(x.field_rms[way.with_noise], error.rms);
          x.field_step = std::max(x.field_step, error.largest_step);
        } else if (e == kCut) {
          x.cut_rms = std::max(x.cut_rms, error.rms);
          x.cut_step = std::max(x.cut_step, error.largest_step);
        } else {
          x.other_rms = std::min(x.other_rms, error.rms);
          x.other_step = std::min(x.other_step, error.largest_step);
        }
      }
    }
  }
  return x;
}

/// Measures every value of `Edges` with every method, at both sides, with and without noise.
Result<FigureResult> figure_edges(Context& context) {
  std::vector<WayPastEdge> ways;
  for (const bool with_noise : {false, true}) {
    const auto frame = seen_pillar(context, with_noise);
    if (!frame) return frame.error();
    for (const PillarSide side : {PillarSide::right, PillarSide::left}) {
      auto way =
          way_past_edge(context, *frame, with_noise, side, static_cast<double>(ways.size()) / 4);
      if (!way) return way.error();
      ways.push_back(*std::move(way));
    }
  }
  FigureResult result;
  const EdgeExtremes x = extremes_of(ways);
  result.claims.push_back(
      {"Where every sphere is cut by the edge plane, boundary spheres too, the "
       "volume is right and smooth past an edge, for every method, camera and side.",
       words("Cut: at most %.1f %% of the tool rms and %.1f %% a step; else at least %.1f and "
             "%.1f %%.",
             100 * x.cut_rms, 100 * x.cut_step, 100 * x.other_rms, 100 * x.other_step),
       holds_with({holds_below(5 * x.cut_rms, x.other_rms, 5 * x.other_rms),
                   holds_below(5 * x.cut_step, x.other_step, 5 * x.other_step)}),
       Source::docs});
  result.claims.push_back(
      {"Past an edge the field is as right without edge planes as the others are where edge planes "
       "cut every sphere.",
       words("At most %.1f %% of the tool rms without noise and %.1f %% with it, the others cut at "
             "most %.1f %%; largest step %.1f %% against %.1f.",
             100 * x.field_rms[0], 100 * x.field_rms[1], 100 * x.cut_rms, 100 * x.field_step,
             100 * x.cut_step),
       holds_up_to(std::max(x.field_rms[0], x.field_rms[1]), kAlike * x.cut_rms, x.other_rms / 2),
       Source::docs});
  result.tables.push_back(table_of(ways));
  for (const WayPastEdge& way : ways) add_numbers(result, way);
  result.plots.push_back(plot_of(ways.back()));
  result.notes.push_back(words(
      "A box of 8 cm with %d spheres, tilted by 20 degrees, half inside, in steps of %.2f mm.",
      kSpheres, 1e3 * step_of_way(context)));
  return result;
}

}  // namespace

std::vector<FigureSpec> edge_figures() {
  return {
      {"3.12/3.13", "Depth-change vectors at a pillar", "Time and edges", figure_3_12},
      {"3.14", "Tunnelling past an edge", "Time and edges", figure_3_14},
      {"edges", "Every kind of edge plane with every method", "Time and edges", figure_edges},
  };
}

}  // namespace palpate::eval
