// 3.10, 5.6: time of a query over the whole range of depths, in a synthetic scene; and with more
// spheres and pixels than in the thesis.
#include <algorithm>
#include <array>
#include <cmath>

#include "eval/studies/speed.h"
#include "eval/studies/verdict_rules.h"
#include "palpate/math/geometry.h"

namespace palpate::eval {
namespace {

constexpr double kToolSize = 0.1;    // m
constexpr double kWallDepth = 1.0;   // m
constexpr double kVeryMany = 12000;  // spheres

/// Renders the wall without noise.
Result<FrozenFrame> wall(Context& context, int width, int height) {
  auto scene = scenes::make_scene("wall");
  if (!scene) return scene.error();
  scenes::set_image_size(*scene, width, height);
  return seen_scene(context, *scene, false);
}

/// Returns `num` poses of the cube with `depth` (share) of it behind the wall, near the axis.
std::vector<Pose> poses_at(double depth, std::size_t num) {
  std::vector<Pose> poses;
  for (std::size_t i = 0; i < num; ++i) {
    const double a = 2 * kPi * static_cast<double>(i) / static_cast<double>(num);
    poses.push_back(
        {{0.02 * std::cos(a), 0.02 * std::sin(3 * a), kWallDepth + kToolSize * (depth - 0.5)},
         axis_angle({0, 0, 1}, 0.3 * std::sin(2 * a))});
  }
  return poses;
}

Result<SpeedSweep> sweep_depths(Context& context, const FrozenFrame& frame, int num_spheres,
                                const std::vector<Method>& methods) {
  const auto tool = context.thesis_tool("box", kToolSize, num_spheres);
  if (!tool) return tool.error();
  auto query = query_on(frame, **tool, context.settings().backend);
  SpeedSweep sweep;
  sweep.methods = methods;
  sweep.times.resize(methods.size());
  const int steps = context.choose(20, 5);
  for (int i = 0; i <= steps; ++i) {
    const double depth = static_cast<double>(i) / steps;
    const auto poses = poses_at(depth, context.choose<std::size_t>(60, 10));
    sweep.x.push_back(100 * depth);
    for (std::size_t m = 0; m < methods.size(); ++m) {
      sweep.times[m].push_back(time_queries(*query, methods[m].options, poses));
    }
  }
  return sweep;
}

Result<FigureResult> figure_3_10(Context& context) {
  const auto frame = wall(context, 640, 480);
  if (!frame) return frame.error();
  FigureResult result;
  struct Case {
    int spheres;
    double graph_until;  // % depth, claimed
  };
  for (const Case& c : {Case{536, 25}, Case{5505, 40}, Case{10062, 40}}) {
    const auto sweep = sweep_depths(context, *frame, c.spheres, all_methods());
    if (!sweep) return sweep.error();
    Plot plot = speed_plot(*sweep, words("Cube into a wall, %d spheres", c.spheres), "depth, %");
    const auto graph = sweep->medians(sweep->method("graph"));
    const auto simplified = sweep->medians(sweep->method("simplified"));
    const double longest = largest_of(graph) / largest_of(simplified);
    const auto in_contact = [&](const std::vector<double>& other) {
      return where_below({sweep->x.begin() + 1, sweep->x.end()}, {graph.begin() + 1, graph.end()},
                         {other.begin() + 1, other.end()}, "depth", "% depth");
    };
    const std::string where = in_contact(simplified);
    plot.caption =
        words("The graph beats simplified %s; its longest query takes %.2f times as long.",
              where.c_str(), longest);
    result.claims.push_back(
        {words("With %d spheres the graph is faster than simplified below %.0f %% depth.",
               c.spheres, c.graph_until),
         plot.caption, is_below_until(sweep->x, graph, simplified, c.graph_until)});
    if (c.spheres == 536) {
      const auto weighted = sweep->medians(sweep->method("weighted"));
      result.claims.push_back(
          {"With 536 spheres weighted is slower than the graph up to about 32 % depth.",
           words("The graph beats weighted %s.", in_contact(weighted).c_str()),
           is_below_until(sweep->x, graph, weighted, 32)});
    }
    add_numbers(result, *sweep, words("time.%d", c.spheres));
    result.plots.push_back(std::move(plot));
  }
  return result;
}

Result<FigureResult> figure_5_6(Context& context) {
  const auto frame = wall(context, 640, 480);
  if (!frame) return frame.error();
  SpeedSweep sweep;
  sweep.methods = all_methods();
  sweep.times.resize(sweep.methods.size());
  const auto num = context.choose<std::size_t>(200, 30);
  std::vector<Pose> poses;
  for (std::size_t i = 0; i < num; ++i) {
    poses.push_back(poses_at(static_cast<double>(i) / static_cast<double>(num), num)[i]);
  }
  for (const int size : context.quick() ? std::vector{500, 5000}
                                        : std::vector{500, 1000, 2000, 5000, 8000, 12000, 17000}) {
    const auto tool = context.thesis_tool("box", kToolSize, size);
    if (!tool) return tool.error();
    auto query = query_on(*frame, **tool, context.settings().backend);
    sweep.x.push_back(size);
    for (std::size_t m = 0; m < sweep.methods.size(); ++m) {
      sweep.times[m].push_back(time_queries(*query, sweep.methods[m].options, poses));
    }
  }
  FigureResult result;
  Plot plot = speed_plot(sweep, "Cube into a wall, depths from 0 to 100 %", "spheres");
  plot.log_y = true;
  // Averages over all depths, as in the thesis.
  const auto graph = sweep.means(sweep.method("graph"));
  const auto simplified = sweep.means(sweep.method("simplified"));
  const double limit = reaches(sweep.x, simplified, 1000);
  plot.caption = words("Simplified stays below 1 ms %s %.0f spheres.",
                       limit >= sweep.x.back() ? "beyond" : "up to", limit);
  result.claims.push_back(
      {"Over all depths simplified takes about 1 ms up to 2,000 spheres (GTX 780).",
       words("That GPU was not at hand; on %s it stays below 1 ms %s %.0f spheres.",
             context.place().c_str(), limit >= sweep.x.back() ? "beyond" : "up to", limit),
       Verdict::not_comparable});
  result.claims.push_back(
      {"Over all depths the graph wins only for very many spheres.",
       "The graph beats simplified " + where_below(sweep.x, graph, simplified) + ".",
       is_below_from(sweep.x, graph, simplified, kVeryMany)});
  add_numbers(result, sweep, "time");
  result.plots = {plot};
  return result;
}

Result<FigureResult> more_spheres(Context& context) {
  const auto frame = wall(context, 640, 480);
  if (!frame) return frame.error();
  SpeedSweep sweep;
  for (const Method& method : all_methods()) {
    // Weighted takes too long for so many spheres; the capped graph takes as long as the graph.
    const bool is_capped = method.options.inside == InsideVolume::cap;
    if (method.options.method == MethodKind::weighted || is_capped) continue;
    sweep.methods.push_back(method);
  }
  sweep.times.resize(sweep.methods.size());
  for (const int size : context.quick() ? std::vector{1000, 17000}
                                        : std::vector{1000, 5000, 17000, 100000, 1000000}) {
    const auto tool = context.tool("box", kToolSize, size);
    if (!tool) return tool.error();
    auto query = query_on(*frame, **tool, context.settings().backend);
    sweep.x.push_back(size);
    const auto poses = poses_at(0.1, context.choose<std::size_t>(60, 10));
    for (std::size_t m = 0; m < sweep.methods.size(); ++m) {
      sweep.times[m].push_back(time_queries(*query, sweep.methods[m].options, poses));
    }
  }
  FigureResult result;
  Plot plot = speed_plot(sweep, "Cube into a wall, 10 % deep", "spheres");
  plot.log_x = plot.log_y = true;
  const auto field = sweep.medians(sweep.method("field"));
  plot.caption =
      words("%g spheres: field %.2f ms, graph %.2f ms, simplified %.2f ms.", sweep.x.back(),
            1e-3 * field.back(), 1e-3 * sweep.medians(sweep.method("graph")).back(),
            1e-3 * sweep.medians(sweep.method("simplified")).back());
  const double limit = reaches(sweep.x, field, 1000);
  const double of_simplified = reaches(sweep.x, sweep.medians(sweep.method("simplified")), 1000);
  result.claims.push_back(
      {"With the field 1 kHz is kept for more spheres than with the fastest method of the thesis.",
       words("Up to %.0f spheres instead of %.0f.", limit, of_simplified),
       is_better(of_simplified, limit), Source::ours});
  add_numbers(result, sweep, "time");
  result.plots = {plot};
  result.tables = {
      time_table(sweep, "Median time of a query, 10 % deep, on " + context.place() + ", µs")};
  return result;
}

Result<FigureResult> more_pixels(Context& context) {
  const auto tool = context.tool("box", kToolSize, 5000);
  if (!tool) return tool.error();
  SpeedSweep sweep;
  sweep.methods = all_methods();
  sweep.times.resize(sweep.methods.size());
  const auto sizes = context.quick() ? std::vector<std::array<int, 2>>{{640, 480}}
                                     : std::vector<std::array<int, 2>>{
                                           {320, 240}, {640, 480}, {1280, 960}, {1920, 1080}};
  for (const auto& [width, height] : sizes) {
    const auto frame = wall(context, width, height);
    if (!frame) return frame.error();
    auto query = query_on(*frame, **tool, context.settings().backend);
    sweep.x.push_back(1e-6 * width * height);
    const auto poses = poses_at(0.1, context.choose<std::size_t>(60, 10));
    for (std::size_t m = 0; m < sweep.methods.size(); ++m) {
      sweep.times[m].push_back(time_queries(*query, sweep.methods[m].options, poses));
    }
  }
  FigureResult result;
  Plot plot =
      speed_plot(sweep, "Cube into a wall, 10 % deep, 5,000 spheres", "megapixels of the camera");
  const auto field = sweep.medians(sweep.method("field"));
  const auto simplified = sweep.medians(sweep.method("simplified"));
  plot.caption = words(
      "From %.2g to %.2g megapixels simplified goes from %.0f to %.0f µs, the field "
      "from %.0f to %.0f: it asks once per sphere, however many pixels there are.",
      sweep.x.front(), sweep.x.back(), simplified.front(), simplified.back(), field.front(),
      field.back());
  result.claims.push_back(
      {"Larger images cost the field less than simplified.", plot.caption,
       is_better(field.back() / field.front(), simplified.back() / simplified.front()),
       Source::ours});
  add_numbers(result, sweep, "time");
  result.plots = {plot};
  return result;
}

}  // namespace

std::vector<FigureSpec> synthetic_speed() {
  return {
      {"3.10", "Full penetration: depth against time", "Speed", figure_3_10, true, true},
      {"5.6", "Synthetic scene, all depths", "Speed", figure_5_6, true, true},
      {"spheres", "More spheres than the thesis", "Speed", more_spheres, true, true},
      {"pixels", "Larger cameras", "Speed", more_pixels, true, true},
  };
}

}  // namespace palpate::eval
