// 5.5: time of each part of a query.
#include <algorithm>
#include <vector>

#include "eval/studies/boundary_stage.h"
#include "eval/studies/speed.h"
#include "eval/studies/verdict_rules.h"

namespace palpate::eval {
namespace {

constexpr double kFlat = 1.5;  // largest over smallest time

Result<FigureResult> figure_5_5(Context& context) {
  const auto scene = recorded_interaction(context);
  if (!scene) return scene.error();
  FigureResult result;
  double flattest = 0, steepest = 0;  // largest over smallest time, over sizes
  double detection_depth = 0, graph_depth = 0;
  std::vector<double> detection_at, graph_at;  // at the largest size, over depths
  const std::vector<double> depths =
      context.quick() ? std::vector{0.1, 0.4} : std::vector{0.1, 0.28, 0.4};
  for (const double depth : depths) {
    Plot plot;
    plot.title = words("%s, %.0f %% deep", scene->name.c_str(), 100 * depth);
    plot.x_label = "spheres";
    plot.y_label = "time, µs (median)";
    Curve detection{"collision detection (all but field)", "other1", {}, {}};
    Curve graph{"graph: all after it", "graph", {}, {}};
    Curve simplified{"simplified: all after it", "simplified", {}, {}};
    for (const int size :
         context.quick() ? std::vector{500, 5000} : std::vector{500, 2000, 5000, 10000, 17000}) {
      const auto tool = context.thesis_tool(scene->shape, scene->size, size);
      if (!tool) return tool.error();
      const auto path =
          hand_path(scene->frame, **tool, depth, context.choose<std::size_t>(200, 30));
      if (!path) return path.error();
      auto query = query_on(scene->frame, **tool);
      BoundaryStage stage(**tool, scene->frame.cloud());
      const double alone = 1e6 * time_calls(path->X_WT.size(), [&](std::size_t i) {
                                   stage.run(path->X_WT[i], [](std::size_t, const PointSums&) {});
                                 }).median;
      const auto rest = [&](const Method& method) {
        return std::max(0.0, 1e6 * time_queries(*query, method.options, path->X_WT).median - alone);
      };
      const auto methods = thesis_methods();
      detection.x.push_back(size), detection.y.push_back(alone);
      graph.x.push_back(size), graph.y.push_back(rest(methods[2]));
      simplified.x.push_back(size), simplified.y.push_back(rest(methods[1]));
      const std::string key = words("%.0f.%d.", 100 * depth, size);
      result.numbers.push_back({key + "detection", detection.y.back(), "µs"});
      result.numbers.push_back({key + "graph", graph.y.back(), "µs"});
      result.numbers.push_back({key + "simplified", simplified.y.back(), "µs"});
    }
    flattest = std::max(flattest, detection.y.back() / detection.y.front());
    steepest = std::max(steepest, graph.y.back() / std::max(graph.y.front(), 1.0));
    detection_at.push_back(detection.y.back());
    graph_at.push_back(graph.y.back());
    plot.caption = words(
        "From %g to %g spheres the detection takes %.1f times as long, the graph's "
        "traversal %.0f times.",
        detection.x.front(), detection.x.back(), detection.y.back() / detection.y.front(),
        graph.y.back() / std::max(graph.y.front(), 1.0));
    plot.curves = {detection, graph, simplified};
    result.plots.push_back(std::move(plot));
  }
  detection_depth = *std::max_element(detection_at.begin(), detection_at.end()) /
                    *std::min_element(detection_at.begin(), detection_at.end());
  graph_depth = *std::max_element(graph_at.begin(), graph_at.end()) /
                *std::min_element(graph_at.begin(), graph_at.end());
  result.claims.push_back(
      {"Collision detection is nearly flat in the number of spheres and in depth.",
       words("From 500 to 17,000 spheres it takes up to %.1f times as long, over the depths %.1f "
             "times.",
             flattest, detection_depth),
       are_true({flattest < kFlat, detection_depth < kFlat})});
  result.claims.push_back(
      {"The graph's traversal grows with both.",
       words("Up to %.0f times over the sizes, %.1f times over the depths.", steepest, graph_depth),
       are_true({steepest > kFlat, graph_depth > kFlat})});
  return result;
}

}  // namespace

std::vector<FigureSpec> subtask_figures() {
  return {{"5.5", "Time of each sub-task", "Speed", figure_5_5}};
}

}  // namespace palpate::eval
