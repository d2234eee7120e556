// 3.3, 3.9, 5.1-5.5: time of a query while a hand moves a tool on a recorded scene (thesis section
// 5.1.1).
#include "eval/studies/speed.h"

#include <algorithm>
#include <cmath>

#include "eval/studies/verdict_rules.h"

namespace palpate::eval {
namespace {

constexpr double kTick = 1000;    // microseconds at 1 kHz
constexpr double kFollows = 0.7;  // correlation: half of the variance
/// Swing of an exploring hand, in and out, of the tool's radius.
constexpr double kDeepSwing = 0.8;

/// Measures every method over the number of spheres, at one average depth.
Result<SpeedSweep> sweep_sizes(Context& context, const Interaction& scene, double depth,
                               const std::vector<int>& sizes, std::vector<Method> methods,
                               GapRule rule = GapRule::absolute) {
  SpeedSweep sweep;
  sweep.methods = std::move(methods);
  sweep.times.resize(sweep.methods.size());
  const auto poses = context.choose<std::size_t>(300, 40);
  for (const int size : sizes) {
    const auto tool = context.tool(scene.shape, scene.size, size, rule);
    if (!tool) return tool.error();
    const auto path = hand_path(scene.frame, **tool, depth, poses);
    if (!path) return path.error();
    auto query = query_on(scene.frame, **tool, context.settings().backend);
    sweep.x.push_back(size);
    for (std::size_t m = 0; m < sweep.methods.size(); ++m) {
      sweep.times[m].push_back(time_queries(*query, sweep.methods[m].options, path->X_WT));
    }
  }
  return sweep;
}

/// Returns the time of each query along a path, µs. Each pose is repeated: the minimum is free of
/// interruptions.
Curve times_along(MethodQueries& query, const Method& method, const std::vector<Pose>& X_WT) {
  Curve curve{method.name, method.name, {}, {}};
  for (std::size_t i = 0; i < X_WT.size(); ++i) {
    double least = INFINITY;
    for (int again = 0; again < 5; ++again) {
      const Times t = time_calls(1, [&](std::size_t) { query.query(X_WT[i], method.options); });
      least = std::min(least, t.median);
    }
    curve.x.push_back(100 * static_cast<double>(i) / static_cast<double>(X_WT.size()));
    curve.y.push_back(1e6 * least);
  }
  return curve;
}

std::vector<int> thesis_sizes(const Context& context) {
  if (context.quick()) return {500, 2000, 5000};
  return {500, 1000, 2000, 3000, 5000, 8000, 10000, 12000, 17000};
}

Result<FigureResult> figure_3_3(Context& context) {
  const auto scene = recorded_interaction(context);
  if (!scene) return scene.error();
  const std::vector<int> sizes =
      context.quick() ? std::vector{1000, 2000} : std::vector{1000, 2000, 5000, 10000};
  const auto sweep = sweep_sizes(context, *scene, 0.1, sizes, all_methods());
  if (!sweep) return sweep.error();
  FigureResult result;
  Plot plot = speed_plot(*sweep, scene->name + ", 10 % deep", "spheres");
  Plot ratio;
  ratio.title = "How many times as fast as weighted";
  ratio.x_label = "spheres";
  ratio.y_label = "time of weighted / time";
  const auto weighted = sweep->medians(sweep->method("weighted"));
  double least = INFINITY, most = 0;
  for (const char* name : {"simplified", "graph", "field"}) {
    Curve curve{name, name, sweep->x, sweep->medians(sweep->method(name))};
    for (std::size_t i = 0; i < curve.y.size(); ++i) curve.y[i] = weighted[i] / curve.y[i];
    if (curve.label == "simplified") {
      least = *std::min_element(curve.y.begin(), curve.y.end());
      most = *std::max_element(curve.y.begin(), curve.y.end());
    }
    ratio.curves.push_back(std::move(curve));
  }
  plot.caption = words("Simplified takes 1/%.1f to 1/%.1f of the time of weighted.", least, most);
  std::vector<double> factors = ratio.curves[0].y;
  std::nth_element(factors.begin(),
                   factors.begin() + static_cast<std::ptrdiff_t>(factors.size() / 2),
                   factors.end());
  const double typical = factors[factors.size() / 2];
  ratio.caption =
      "The factor grows with the number of spheres: weighted visits every boundary sphere for "
      "every other sphere.";
  result.claims.push_back({"Simplified brute force is 1.7 times as fast as weighted.",
                           words("%.1f to %.1f times, for %g to %g spheres; %.1f in the middle.",
                                 least, most, sweep->x.front(), sweep->x.back(), typical),
                           is_times(typical, 1, 1.7)});
  add_numbers(result, *sweep, "time");
  result.plots = {plot, ratio};
  return result;
}

Result<FigureResult> figure_3_9(Context& context) {
  const auto scene = recorded_interaction(context);
  if (!scene) return scene.error();
  const auto tool = context.thesis_tool(scene->shape, scene->size, 5000);
  if (!tool) return tool.error();
  const auto path = hand_path(scene->frame, **tool, 0.03, context.choose<std::size_t>(1000, 100));
  if (!path) return path.error();
  auto query = query_on(scene->frame, **tool, context.settings().backend);
  FigureResult result;
  Table table{
      "Shallow scraping, 5,000 spheres", {"method", "mean µs", "deviation µs", "p99 µs"}, {}};
  Plot plot{words("%s, 5,000 spheres, shallow scraping", scene->name.c_str()),
            "share of the path, %",
            "time of one query, µs",
            {},
            false,
            false,
            ""};
  double mean[3] = {}, deviation[3] = {};
  std::size_t m = 0;
  for (const Method& method : all_methods()) {
    const Times t = time_queries(*query, method.options, path->X_WT);
    table.rows.push_back({method.name, words("%.1f", 1e6 * t.mean),
                          words("%.1f", 1e6 * t.deviation), words("%.1f", 1e6 * t.p99)});
    result.numbers.push_back({std::string(method.name) + ".mean", 1e6 * t.mean, "µs"});
    result.numbers.push_back({std::string(method.name) + ".deviation", 1e6 * t.deviation, "µs"});
    if (m < 3) mean[m] = t.mean, deviation[m] = t.deviation;
    plot.curves.push_back(times_along(*query, method, path->X_WT));
    ++m;
  }
  const bool is_faster = mean[2] < mean[0] && mean[2] < mean[1];
  plot.caption =
      words("Mean ± deviation: weighted %.0f ± %.0f µs, simplified %.0f ± %.0f, graph %.0f ± %.0f.",
            1e6 * mean[0], 1e6 * deviation[0], 1e6 * mean[1], 1e6 * deviation[1], 1e6 * mean[2],
            1e6 * deviation[2]);
  result.plots.push_back(std::move(plot));
  result.claims.push_back(
      {"Shallow scraping: the graph has a higher variance and a lower mean than both brute forces.",
       words("Graph %.0f ± %.0f µs, simplified %.0f ± %.0f, weighted %.0f ± %.0f (%.1f %% deep on "
             "average).",
             1e6 * mean[2], 1e6 * deviation[2], 1e6 * mean[1], 1e6 * deviation[1], 1e6 * mean[0],
             1e6 * deviation[0], 100 * path->mean_depth),
       agrees_with({is_less(mean[2], mean[0]), is_less(mean[2], mean[1]),
                    is_less(deviation[0], deviation[2]), is_less(deviation[1], deviation[2])})});
  if (!is_faster && context.settings().backend == Backend::cpu) {
    result.notes.push_back(
        "On a CPU the boundary stage dominates a shallow query, and what the graph saves after it "
        "is "
        "little.");
  }
  result.tables.push_back(std::move(table));
  return result;
}

Result<FigureResult> figure_5_1(Context& context) {
  const auto scene = recorded_interaction(context);
  if (!scene) return scene.error();
  const auto sweep = sweep_sizes(context, *scene, 0.1, thesis_sizes(context), all_methods());
  if (!sweep) return sweep.error();
  const auto of_pack = sweep_sizes(context, *scene, 0.1, thesis_sizes(context),
                                   {thesis_methods().back()}, GapRule::relative);
  if (!of_pack) return of_pack.error();
  FigureResult result;
  Plot plot = speed_plot(*sweep, scene->name + ", 10 % deep", "spheres");
  const double most = sweep->x.back();
  const auto limit_of = [&](const char* name) {
    return reaches(sweep->x, sweep->medians(sweep->method(name)), kTick);
  };
  const auto upto = [&](const char* name) {
    const double limit = limit_of(name);
    return limit >= most ? words("beyond %g", most) : words("up to %.0f", limit);
  };
  plot.caption = words("1 kHz on %s: graph %s spheres, simplified %s, weighted %s, field %s.",
                       context.place().c_str(), upto("graph").c_str(), upto("simplified").c_str(),
                       upto("weighted").c_str(), upto("field").c_str());
  plot.log_y = true;
  const auto graph = sweep->medians(sweep->method("graph"));
  const auto simplified = sweep->medians(sweep->method("simplified"));
  const auto weighted = sweep->medians(sweep->method("weighted"));
  std::vector<double> fastest = simplified;
  for (std::size_t i = 0; i < fastest.size(); ++i) fastest[i] = std::min(fastest[i], weighted[i]);
  const std::vector<double> graph_of_pack = of_pack->medians(0);
  result.claims.push_back(
      {"At 10 % depth the graph is always the fastest.",
       words("%s: the graph beats both brute forces %s; at the largest size (%g) it takes %.0f "
             "(with the gap rule of our packings %.0f) against %.0f µs of simplified, the field "
             "%.0f.",
             scene->name.c_str(), where_below(sweep->x, graph, fastest).c_str(), most, graph.back(),
             graph_of_pack.back(), simplified.back(),
             sweep->medians(sweep->method("field")).back()),
       is_below_until(sweep->x, graph, fastest, INFINITY)});
  result.claims.push_back(
      {"1 kHz (GTX 780): graph to about 5,000 spheres, simplified beyond 2,000, weighted about "
       "1,000.",
       words("That GPU was not at hand; %s keeps it with graph %s, simplified %s, weighted %s, "
             "field %s.",
             context.place().c_str(), upto("graph").c_str(), upto("simplified").c_str(),
             upto("weighted").c_str(), upto("field").c_str()),
       Verdict::not_comparable});
  for (const Method& method : sweep->methods) {
    result.numbers.push_back(
        {std::string("spheres_at_1kHz.") + method.name, limit_of(method.name), "spheres"});
  }
  add_numbers(result, *sweep, "time");
  add_numbers(result, *of_pack, "time.gap_rule_relative");
  plot.curves.push_back({"graph, gap rule of our packings", "other1", sweep->x, graph_of_pack});
  result.plots = {plot};
  return result;
}

/// Makes 5.2 and 5.3: the same at several depths.
Result<FigureResult> over_depths(Context& context, const std::vector<double>& depths,
                                 std::vector<SpeedSweep>& sweeps) {
  const auto scene = recorded_interaction(context);
  if (!scene) return scene.error();
  FigureResult result;
  for (const double depth : depths) {
    const auto sweep =
        sweep_sizes(context, *scene, depth,
                    context.quick() ? std::vector{500, 5000, 8000, 10000}
                                    : std::vector{500, 700, 1000, 3000, 8000, 10000, 13000, 17000},
                    all_methods());
    if (!sweep) return sweep.error();
    Plot plot =
        speed_plot(*sweep, words("%s, %.0f %% deep", scene->name.c_str(), 100 * depth), "spheres");
    plot.log_y = true;
    const auto graph = sweep->medians(sweep->method("graph"));
    const auto simplified = sweep->medians(sweep->method("simplified"));
    plot.caption =
        words("At %g spheres: graph %.0f µs, simplified %.0f, field %.0f.", sweep->x.back(),
              graph.back(), simplified.back(), sweep->medians(sweep->method("field")).back());
    add_numbers(result, *sweep, words("time.%.0f", 100 * depth));
    result.plots.push_back(std::move(plot));
    sweeps.push_back(*sweep);
    context.progress(static_cast<double>(sweeps.size()) / static_cast<double>(depths.size()));
  }
  return result;
}

/// Returns the largest over the smallest time of a method at the largest size, over depths.
double spread(const std::vector<SpeedSweep>& sweeps, const char* name) {
  double least = INFINITY, most = 0;
  for (const SpeedSweep& sweep : sweeps) {
    const double t = sweep.medians(sweep.method(name)).back();
    least = std::min(least, t);
    most = std::max(most, t);
  }
  return most / least;
}

Result<FigureResult> figure_5_2(Context& context) {
  std::vector<SpeedSweep> sweeps;
  const std::vector<double> depths =
      context.quick() ? std::vector{0.07, 0.16} : std::vector{0.07, 0.10, 0.16};
  auto result = over_depths(context, depths, sweeps);
  if (!result) return result;
  const auto graph_of = [](const SpeedSweep& sweep) {
    return sweep.medians(sweep.method("graph"));
  };
  const auto simplified_of = [](const SpeedSweep& sweep) {
    return sweep.medians(sweep.method("simplified"));
  };
  const SpeedSweep &shallow = sweeps.front(), &deep = sweeps.back();
  result->claims.push_back(
      {"The graph is best up to 15 % depth.",
       words("At 7 %% depth it beats simplified %s.",
             where_below(shallow.x, graph_of(shallow), simplified_of(shallow)).c_str()),
       is_below_until(shallow.x, graph_of(shallow), simplified_of(shallow), INFINITY)});
  result->claims.push_back(
      {"At 16 % simplified is faster for up to 700 spheres, and the graph for more.",
       words("At 16 %% depth the graph beats simplified %s.",
             where_below(deep.x, graph_of(deep), simplified_of(deep)).c_str()),
       is_below_from(deep.x, graph_of(deep), simplified_of(deep), 701)});
  result->claims.push_back(
      {"Brute force does not depend on the depth.",
       words(
           "From 7 to 16 %% depth simplified changes by a factor of %.2f, graph %.2f, field %.2f.",
           spread(sweeps, "simplified"), spread(sweeps, "graph"), spread(sweeps, "field")),
       is_as_good(spread(sweeps, "simplified"), 1)});
  return result;
}

Result<FigureResult> figure_5_3(Context& context) {
  std::vector<SpeedSweep> sweeps;
  const std::vector<double> depths =
      context.quick() ? std::vector{0.28, 0.46} : std::vector{0.28, 0.31, 0.40, 0.46};
  auto result = over_depths(context, depths, sweeps);
  if (!result) return result;
  const SpeedSweep& deep = context.quick() ? sweeps.back() : sweeps[2];
  const auto graph = deep.medians(deep.method("graph"));
  const auto simplified = deep.medians(deep.method("simplified"));
  result->claims.push_back({"Deep contact: the graph is slower for few spheres.",
                            words("With %g spheres it takes %.0f against %.0f µs.", deep.x.front(),
                                  graph.front(), simplified.front()),
                            is_less(simplified.front(), graph.front())});
  result->claims.push_back({"At 40 % the graph wins only from about 13,000 spheres on.",
                            words("It wins %s (with %g spheres it takes %.0f against %.0f µs).",
                                  where_below(deep.x, graph, simplified).c_str(), deep.x.back(),
                                  graph.back(), simplified.back()),
                            is_below_from(deep.x, graph, simplified, 13000)});
  const auto at = [&](const std::vector<double>& times, double size) {
    const auto found = std::find(deep.x.begin(), deep.x.end(), size);
    return found == deep.x.end() ? std::nan("")
                                 : times[static_cast<std::size_t>(found - deep.x.begin())];
  };
  result->claims.push_back(
      {"The curves have dents: 8,000 spheres take longer than 10,000.",
       words("With 8,000 and 10,000 spheres the graph takes %.0f and %.0f µs, simplified %.0f and "
             "%.0f.",
             at(graph, 8000), at(graph, 10000), at(simplified, 8000), at(simplified, 10000)),
       agrees_with({is_less(at(graph, 10000), at(graph, 8000)),
                    is_less(at(simplified, 10000), at(simplified, 8000))})});
  if (context.settings().backend == Backend::cpu) {
    result->notes.push_back("On a CPU no launch of threads has to fit a number of spheres.");
  }
  return result;
}

Result<FigureResult> figure_5_4(Context& context) {
  const auto scene = recorded_interaction(context);
  if (!scene) return scene.error();
  const auto tool = context.thesis_tool(scene->shape, scene->size, 5000);
  if (!tool) return tool.error();
  auto query = query_on(scene->frame, **tool, context.settings().backend);
  const double whole = full_volume(**tool, ContactOptions{});
  FigureResult result;
  for (const double depth : {0.28, 0.40}) {
    const auto path =
        hand_path(scene->frame, **tool, depth, context.choose<std::size_t>(400, 60), kDeepSwing);
    if (!path) return path.error();
    Plot plot;
    plot.title = words("%s, 5,000 spheres, %.0f %% deep", scene->name.c_str(), 100 * depth);
    plot.x_label = "share of the path, %";
    plot.y_label = "time of one query, µs";
    std::vector<double> depths, correlations;
    for (const Pose& X_WT : path->X_WT) {
      depths.push_back(100 * query->query(X_WT, ContactOptions{}).volume / whole);
    }
    for (const Method& method : all_methods()) {
      Curve curve = times_along(*query, method, path->X_WT);
      double mean_t = 0, mean_d = 0, tt = 0, dd = 0, td = 0;
      const auto n = static_cast<double>(depths.size());
      for (std::size_t i = 0; i < depths.size(); ++i) {
        mean_t += curve.y[i] / n;
        mean_d += depths[i] / n;
      }
      for (std::size_t i = 0; i < depths.size(); ++i) {
        const double t = curve.y[i] - mean_t, d = depths[i] - mean_d;
        tt += t * t, dd += d * d, td += t * d;
      }
      correlations.push_back(td / std::sqrt(tt * dd));
      result.numbers.push_back(
          {words("correlation.%.0f.%s", 100 * depth, method.name), correlations.back(), "1"});
      plot.curves.push_back(std::move(curve));
    }
    plot.caption = words(
        "Correlation of time and depth: weighted %.2f, simplified %.2f, graph %.2f, "
        "field %.2f.",
        correlations[0], correlations[1], correlations[2], correlations[4]);
    result.claims.push_back(
        {words(
             "Along a path of %.0f %% average depth the time of the graph follows the depth, more "
             "than that of brute force.",
             100 * depth),
         words("Correlation of the graph's time with the depth %.2f, of simplified's %.2f.",
               correlations[2], correlations[1]),
         are_true({correlations[2] > kFollows, correlations[2] > correlations[1]})});
    result.plots.push_back(std::move(plot));
  }
  return result;
}

}  // namespace

std::vector<FigureSpec> speed_figures() {
  std::vector<FigureSpec> figures{
      {"3.3", "Weighted against simplified brute force", "Speed", figure_3_3, true, true},
      {"3.9", "Shallow scraping: mean and variance", "Speed", figure_3_9, true, true},
      {"5.1", "Realistic interaction at 10 % depth", "Speed", figure_5_1, true, true},
      {"5.2", "Shallow and medium contact, 7 to 16 %", "Speed", figure_5_2, true, true},
      {"5.3", "Deep contact, 28 to 46 %", "Speed", figure_5_3, true, true},
      {"5.4", "Time along a path", "Speed", figure_5_4, true, true},
  };
  for (const auto more :
       {subtask_figures, synthetic_speed, option_speed, sensing_speed, gpu_figures}) {
    for (const FigureSpec& figure : more()) figures.push_back(figure);
  }
  return figures;
}

}  // namespace palpate::eval
