// others: other methods on the same scenes: a lookup in a voxel grid of distances, a god-object on
// the cloud, coal with an octree; their accuracy, smoothness, speed and memory.
#include <malloc.h>

#include <algorithm>
#include <cmath>

#include "eval/figures/option_figures.h"
#include "eval/report/csv.h"
#include "eval/studies/other_methods.h"
#include "eval/studies/parallel.h"
#include "eval/studies/speed.h"
#include "eval/studies/verdict_rules.h"

namespace palpate::eval {
namespace {

constexpr double kCells[] = {0.005, 0.01, 0.02, 0.05};  // m
constexpr double kReach = 0.01;                         // m: radius of the god-object's surface
constexpr double kMegabyte = 1e6;

/// Methods; those by a grid sum caps of the spheres, or sphere depths as motion planners do.
enum class Way { ours, grid_caps, grid_hinge, god_object };
bool is_grid(Way way) { return way == Way::grid_caps || way == Way::grid_hinge; }

struct Row {
  std::string key, name;
  Way way = Way::ours;
  ContactOptions options;
  double cell = 0;
  /// rms over the cases: % of the tool, % of the tool, degrees, %; the largest step, exact = 1.
  /// NaN: not available.
  double volume = std::nan(""), force = std::nan(""), direction = 0, torque = std::nan(""),
         jump = 0;
  Times query, frame;
  double memory = 0;  ///< bytes
};

std::vector<Row> all_rows() {
  std::vector<Row> rows;
  for (const Method& method : all_methods_alike()) {
    Row& row = rows.emplace_back();
    row.key = row.name = method.name;
    row.options = method.options;
  }
  for (const double cell : kCells) {
    for (const Way way : {Way::grid_caps, Way::grid_hinge}) {
      Row& row = rows.emplace_back();
      const char* const what = way == Way::grid_caps ? "caps" : "hinge";
      row.way = way, row.cell = cell;
      row.key = words("grid_%.0f_mm_%s", 1e3 * cell, what);
      row.name = words("distance grid, %.0f mm, %s", 1e3 * cell, what);
    }
  }
  Row& row = rows.emplace_back();
  row.way = Way::god_object, row.key = "god_object", row.name = "god-object";
  return rows;
}

/// Middle of a case's way, and the half width of a cube around all of it.
Vec3d middle_of(const ContactCase& c) { return 0.5 * (c.start.translation + c.end.translation); }
double half_width_of(const ContactCase& c) {
  return norm(c.end.translation - c.start.translation) + 2.2 * c.tool_size;
}

/// Returns the point of the tool that touches first.
Vec3d foremost(const Tool& tool, const Pose& X_WT) {
  Vec3d best_T;
  double most = -INFINITY;
  for (const Vec3d& p : tool.mesh().vertices) {
    const double z = (X_WT * p).z;
    if (z > most) most = z, best_T = p;
  }
  return best_T;
}

/// Makes a measure that is ready for queries; the tool, the case and the scene have to outlive it.
Measure measure_of(const Row& row, const ContactCase& c, const Tool& tool,
                   const RenderedScene& seen, const ExactStep& scale) {
  if (row.way == Way::ours) return query_measure(tool, seen, row.options);
  const PointCloudView cloud = seen.surface.cloud();
  std::function<Penetration(const Pose&)> pull;
  if (is_grid(row.way)) {
    const auto grid =
        std::make_shared<const DistanceGrid>(cloud, middle_of(c), half_width_of(c), row.cell);
    if (row.way == Way::grid_caps) {
      return distance_measure(tool, SphereVolumes::represented,
                              [grid](const Vec3d& p) { return grid->at(p); });
    }
    pull = [grid, &tool](const Pose& X_WT) { return grid->hinge(tool, X_WT); };
  } else {
    const auto proxy = std::make_shared<GodObject>(cloud, kReach);
    const Vec3d p_T = foremost(tool, c.start);
    pull = [proxy, p_T](const Pose& X_WT) {
      Penetration result;
      result.measure_W.force = proxy->pull(X_WT * p_T);
      return result;
    };
  }
  // The stiffness scales its force to the exact one at `scale`.
  double length = 0;
  for (int i = 0; i <= 60; ++i) {
    length = norm(pull(interpolate(c.start, scale.X_WT, i / 60.0)).measure_W.force);
  }
  const double share = norm(scale.exact.measure_C_W.force) / tool.mesh_mass().volume;
  return {length > 0 ? length / share : 1, pull};
}

/// Returns the heap memory in use, bytes.
double in_use() {
  const auto info = mallinfo2();
  return static_cast<double>(info.uordblks + info.hblkhd);
}

/// Measures the time of a frame and of a query, and the memory of both.
void measure_cost(Context& context, Row& row, const ContactCase& c, const Tool& tool) {
  const scenes::Scene scene = scenes::make_scene(c.scene).value();
  const std::vector<float> depth = scenes::render_depth(scene, 0);
  const auto steps = exact_steps(c, tool, 0.1, 0.3, context.choose(300, 30));
  ThreadPool pool(1);
  const double before = in_use();
  RenderedScene seen{SurfaceEstimator::create(scene.width, scene.height, scene.intrinsics).value(),
                     DepthField::create(scene.width, scene.height).value()};
  const double of_field = [&] {
    const double start = in_use();
    const auto another = DepthField::create(scene.width, scene.height).value();
    return in_use() - start;
  }();
  const bool is_field = row.way == Way::ours && row.options.method == MethodKind::field;
  row.frame = time_calls(context.choose<std::size_t>(20, 3), [&](std::size_t) {
    seen.surface.update(std::span<const float>(depth), pool);
    if (is_field) seen.field.update(seen.surface.cloud(), pool);
    if (!is_grid(row.way)) return;
    const DistanceGrid grid(seen.surface.cloud(), middle_of(c), half_width_of(c), row.cell);
  });
  const Measure measure = measure_of(row, c, tool, seen, steps.back());
  row.query = time_calls(steps.size(), [&](std::size_t i) { (void)measure.at(steps[i].X_WT); });
  row.memory = in_use() - before - (is_field ? 0 : of_field);
}

std::string or_none(const char* format, double value) {
  char text[32];
  std::snprintf(text, sizeof text, format, value);
  return std::isfinite(value) ? text : "none";
}

}  // namespace

Result<FigureResult> figure_others(Context& context) {
  std::vector<ContactCase> cases = tilted_cases();
  if (context.quick()) cases.resize(2);
  std::vector<Row> rows = all_rows();
  std::vector<std::vector<Row>> by_case(cases.size(), rows);
  std::vector<std::shared_ptr<const Tool>> tools;
  for (const ContactCase& c : cases) {
    const auto tool = context.tool(c.tool_shape, c.tool_size, context.choose(1000, 300));
    if (!tool) return tool.error();
    tools.push_back(*tool);
  }
  const int num_coarse = context.choose(100, 20), num_fine = context.choose(200, 20);
  run_tasks(context, static_cast<int>(cases.size()),
            static_cast<double>(cases.size() * rows.size()), [&](int task, Work& work) {
              const auto i = static_cast<std::size_t>(task);
              const ContactCase& c = cases[i];
              const Tool& tool = *tools[i];
              const RenderedScene seen = see(c, DepthNoise::gaussian);
              const auto coarse = exact_steps(c, tool, 0, 0.6, num_coarse);
              const double fine = num_fine / static_cast<double>(num_steps_over(c, 1, 5e-5));
              const auto steps = exact_steps(c, tool, 0.3, 0.3 + fine, num_fine);
              for (Row& row : by_case[i]) {
                const Measure measure = measure_of(row, c, tool, seen, steps.front());
                const WrenchError at_steps = wrench_error(tool, steps, measure);
                row.jump = at_steps.jump_ratio();
                const Measure again = measure_of(row, c, tool, seen, steps.front());
                const WrenchError error = wrench_error(tool, coarse, again);
                row.direction = error.direction_rms;
                if (row.way != Way::god_object) row.torque = error.torque_rms;
                if (row.way == Way::ours || row.way == Way::grid_caps) {
                  row.force = error.force_rms;
                  row.volume = volume_error(tool, coarse, again).rms;
                }
                work.step();
              }
            });
  const auto n = static_cast<double>(cases.size());
  for (std::size_t r = 0; r < rows.size(); ++r) {
    double volume = 0, force = 0, direction = 0, torque = 0, jump = 0;
    for (const auto& of_case : by_case) {
      volume += of_case[r].volume * of_case[r].volume / n;
      force += of_case[r].force * of_case[r].force / n;
      direction += of_case[r].direction * of_case[r].direction / n;
      torque += of_case[r].torque * of_case[r].torque / n;
      jump += of_case[r].jump * of_case[r].jump / n;
    }
    rows[r].volume = 100 * std::sqrt(volume), rows[r].force = 100 * std::sqrt(force);
    rows[r].torque = 100 * std::sqrt(torque);
    rows[r].direction = 180 / kPi * std::sqrt(direction), rows[r].jump = std::sqrt(jump);
    measure_cost(context, rows[r], cases[0], *tools[0]);
  }

  FigureResult result;
  Table table{"Palpate, the thesis and alternatives, 1.5 mm noise",
              {"method", "volume, % rms", "force, % rms", "direction, ° rms", "torque, % rms",
               "largest step, exact = 1", "a query, µs", "a frame, ms", "memory, MB"},
              {}};
  for (const Row& row : rows) {
    table.rows.push_back({row.name, or_none("%.2f", row.volume), or_none("%.2f", row.force),
                          or_none("%.2f", row.direction), or_none("%.2f", row.torque),
                          or_none("%.2f", row.jump), time_words(1e6 * row.query.median),
                          words("%.1f", 1e3 * row.frame.median),
                          words("%.1f", row.memory / kMegabyte)});
    const auto number = [&](const char* what, double value, const char* unit) {
      if (std::isfinite(value)) result.numbers.push_back({row.key + what, value, unit});
    };
    number(".volume_rms", row.volume, "%");
    number(".force_rms", row.force, "%");
    number(".direction_rms", row.direction, "deg");
    number(".torque_rms", row.torque, "%");
    number(".jump_ratio", row.jump, "1");
    number(".query", 1e6 * row.query.median, "µs");
    number(".frame", 1e3 * row.frame.median, "ms");
    number(".memory", row.memory / kMegabyte, "MB");
  }
  const Row& field = *std::find_if(rows.begin(), rows.end(), [](const Row& row) {
    return row.way == Way::ours && row.options.method == MethodKind::field;
  });
  bool has_coal = false;
  if (!context.settings().peers.empty()) {
    for (auto& row : read_csv(context.settings().peers).rows) {
      if (!row["case"].starts_with("octree/")) continue;
      auto facts = named_values(row["facts"], ' ', '=');
      const double query = finite_number(row["peer_median_us"]).value_or(0);
      const double frame = finite_number(row["build_us"]).value_or(0);
      const auto fact = [&](const char* name) {
        return finite_number(facts[name]).value_or(std::nan(""));
      };
      table.rows.push_back({row["peer"], "none", "none", or_none("%.2f", fact("direction_deg")),
                            "none", "none", time_words(query), words("%.1f", 1e-3 * frame),
                            or_none("%.1f", fact("memory_MB"))});
      const std::string key = "coal." + named_values(row["case"], '/', ':')["voxel"] + "_mm";
      result.numbers.push_back({key + ".direction_rms", fact("direction_deg"), "deg"});
      result.numbers.push_back({key + ".query", query, "µs"});
      result.claims.push_back(
          {words("The field is nearer to the exact direction and faster to ask than a %s.",
                 row["peer"].c_str()),
           words("Direction %.2f° on all pairs against %.2f on the first, a query %.0f µs against "
                 "%.0f.",
                 field.direction, fact("direction_deg"), 1e6 * field.query.median, query),
           is_better_in_all({is_better(field.direction, fact("direction_deg")),
                             is_better(1e6 * field.query.median, query)}),
           Source::ours});
      has_coal = true;
    }
  }
  const auto value_of = [](const Row& row, std::size_t v) {
    const double values[] = {row.volume,
                             row.direction,
                             row.jump,
                             1e6 * row.query.median,
                             1e3 * row.frame.median,
                             row.memory / kMegabyte};
    return values[v];
  };
  const char* titles[] = {"How wrong is the volume?",     "How wrong is the direction?",
                          "How far does the force jump?", "How long does a query take?",
                          "How long does a frame take?",  "How much memory?"};
  const char* labels[] = {"volume, % rms", "direction, ° rms", "largest step, exact = 1",
                          "a query, µs",   "a frame, ms",      "memory, MB"};
  std::string order;
  for (const Row& row : rows) order += (order.empty() ? "" : ", ") + row.name;
  for (std::size_t v = 0; v < std::size(titles); ++v) {
    Plot plot{titles[v], order, labels[v], {}, false, true, ""};
    double least = INFINITY;
    std::string best;
    for (std::size_t r = 0; r < rows.size(); ++r) {
      const double value = value_of(rows[r], v);
      if (!std::isfinite(value)) continue;
      const bool is_ours = rows[r].way == Way::ours;
      plot.curves.push_back({rows[r].name,
                             is_ours ? rows[r].key : words("other%zu", r % 4 + 1),
                             {static_cast<double>(r + 1)},
                             {value}});
      if (value < least) least = value, best = rows[r].name;
    }
    plot.caption = words("Least: %s with %.3g.", best.c_str(), least);
    result.plots.push_back(std::move(plot));
  }
  for (const Row& row : rows) {
    if (row.way == Way::ours) continue;
    std::vector<Verdict> verdicts{is_better(field.direction, row.direction),
                                  is_better(field.jump, row.jump),
                                  is_better(field.query.median, row.query.median)};
    if (std::isfinite(row.volume)) verdicts.push_back(is_better(field.volume, row.volume));
    result.claims.push_back(
        {words("The field is nearer to the exact wrench, smoother and faster to ask than a %s.",
               row.name.c_str()),
         words(
             "Direction %.2f° against %.2f, largest step %.2f times the exact one against %.2f, a "
             "query %.0f µs against %.0f, a frame %.1f ms against %.1f.",
             field.direction, row.direction, field.jump, row.jump, 1e6 * field.query.median,
             1e6 * row.query.median, 1e3 * field.frame.median, 1e3 * row.frame.median),
         is_better_in_all(verdicts), Source::ours});
  }
  result.tables.push_back(std::move(table));
  result.notes.push_back(words(
      "Errors on %zu pairs that are tilted and off the axis, to 60 %% of the way, %d spheres; "
      "times and memory of the first pair, one thread: a frame is cloud and normals, and what "
      "is made of them. The distance grid is a cube around the tool's way, asked at the "
      "centers of the spheres; a library for whole rooms keeps more. Each cell has the distance to "
      "the mean of the points of the nearest cell that has any. Caps: the volume that each sphere "
      "has behind the plane there, as ours. Hinge: the depth of each sphere times the gradient, "
      "summed, as planners do, which is no volume. The god-object is one point of the tool. The "
      "stiffness of both is the one that is right at 30 %% of the way. Memory is what the heap "
      "grows by.",
      cases.size(), context.choose(1000, 300)));
  if (!has_coal) {
    result.notes.push_back(
        "coal with an octree is not among the --peers: make peer-times measures it "
        "(bench/coal_peer.py, the Python package coal).");
  }
  return result;
}

}  // namespace palpate::eval
