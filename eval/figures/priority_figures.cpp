// priorities: alternative criteria for the donor sphere of a plane (an open question of the thesis,
// sections 3.2.2 and 6): errors and smoothness by each priority, against the exact wrench.
#include <algorithm>
#include <cmath>

#include "eval/context.h"
#include "eval/figures/option_figures.h"
#include "eval/studies/accuracy.h"
#include "eval/studies/parallel.h"
#include "eval/studies/speed.h"
#include "eval/studies/verdict_rules.h"

namespace palpate::eval {
namespace {

constexpr int kSpheres = 1000;

struct Row {
  std::string method;
  ContactOptions options;
  double volume = 0, direction = 0, torque = 0;  ///< % rms, degrees rms, % rms
  double jump = 0;                               ///< exact = 1, rms over the scenes
  Times times;                                   ///< of a query

  std::string priority() const { return name_of(options.priority); }
  std::string key() const { return method + "." + priority(); }
};

/// Returns all rows; for `simplified` square and gaussian equal the distance.
std::vector<Row> all_rows() {
  std::vector<Row> rows;
  for (const MethodKind method : {MethodKind::weighted, MethodKind::simplified}) {
    for (std::size_t p = 0; p < names_of(Priority{}).size(); ++p) {
      const auto priority = static_cast<Priority>(p);
      const bool is_distance = priority == Priority::square || priority == Priority::gaussian;
      if (method == MethodKind::simplified && is_distance) continue;
      Row& row = rows.emplace_back();
      row.method = name_of(method);
      row.options = {.method = method, .priority = priority, .volumes = SphereVolumes::represented};
    }
  }
  return rows;
}

/// Adds the errors of a row in one case.
void measure(Row& row, const Tool& tool, const RenderedScene& seen,
             const std::vector<ExactStep>& coarse, const std::vector<ExactStep>& fine) {
  const Measure measure = query_measure(tool, seen, row.options);
  row.volume = volume_error(tool, coarse, measure).rms;
  const WrenchError wrench = wrench_error(tool, coarse, measure);
  row.direction = wrench.direction_rms, row.torque = wrench.torque_rms;
  row.jump = wrench_error(tool, fine, measure).jump_ratio();
}

}  // namespace

Result<FigureResult> figure_priorities(Context& context) {
  std::vector<ContactCase> cases = tilted_cases();
  if (context.quick()) cases.resize(2);
  std::vector<Row> rows = all_rows();
  std::vector<std::vector<Row>> by_case(cases.size(), rows);
  std::vector<std::shared_ptr<const Tool>> tools;
  for (const ContactCase& c : cases) {
    const auto tool = context.tool(c.tool_shape, c.tool_size, context.choose(kSpheres, 300));
    if (!tool) return tool.error();
    tools.push_back(*tool);
  }
  const int num_coarse = context.choose(40, 10), num_fine = context.choose(200, 20);
  run_tasks(context, static_cast<int>(cases.size()),
            static_cast<double>(cases.size() * rows.size()), [&](int task, Work& work) {
              const auto i = static_cast<std::size_t>(task);
              const Tool& tool = *tools[i];
              const RenderedScene seen = see(cases[i], DepthNoise::gaussian);
              const auto coarse = exact_steps(cases[i], tool, 0, 1, num_coarse);
              // Steps of 0.05 mm, a tick at 50 mm/s.
              const double fine = num_fine / static_cast<double>(num_steps_over(cases[i], 1, 5e-5));
              const auto steps = exact_steps(cases[i], tool, 0.3, 0.3 + fine, num_fine);
              for (Row& row : by_case[i]) {
                measure(row, tool, seen, coarse, steps);
                work.step();
              }
            });
  const RenderedScene seen = see(cases[0], DepthNoise::gaussian);
  const auto steps = exact_steps(cases[0], *tools[0], 0.1, 0.3, context.choose(400, 40));
  for (Row& row : rows) {
    const Measure measure = query_measure(*tools[0], seen, row.options);
    row.times = time_calls(steps.size(), [&](std::size_t i) { (void)measure.at(steps[i].X_WT); });
  }
  const auto n = static_cast<double>(cases.size());
  for (std::size_t r = 0; r < rows.size(); ++r) {
    Row sum;
    for (const auto& of_case : by_case) {
      sum.volume += of_case[r].volume * of_case[r].volume / n;
      sum.direction += of_case[r].direction * of_case[r].direction / n;
      sum.torque += of_case[r].torque * of_case[r].torque / n;
      sum.jump += of_case[r].jump * of_case[r].jump / n;
    }
    rows[r].volume = 100 * std::sqrt(sum.volume), rows[r].torque = 100 * std::sqrt(sum.torque);
    rows[r].direction = 180 / kPi * std::sqrt(sum.direction), rows[r].jump = std::sqrt(sum.jump);
  }
  FigureResult result;
  Table table{"By priority, 1.5 mm noise",
              {"method", "priority", "volume, % rms", "direction, ° rms", "torque, % rms",
               "largest step, exact = 1", "a query, µs"},
              {}};
  const char* titles[] = {"Volume", "Direction", "Smoothness", "Time"};
  const char* labels[] = {"error, % rms", "error, ° rms", "largest step, exact = 1",
                          "time of one query, µs (median)"};
  const auto value_of = [](const Row& row, std::size_t v) {
    const double values[] = {row.volume, row.direction, row.jump, 1e6 * row.times.median};
    return values[v];
  };
  for (const Row& row : rows) {
    table.rows.push_back({row.method, row.priority(), words("%.2f", row.volume),
                          words("%.2f", row.direction), words("%.2f", row.torque),
                          words("%.1f", row.jump), time_words(1e6 * row.times.median)});
    result.numbers.push_back({row.key() + ".volume_rms", row.volume, "%"});
    result.numbers.push_back({row.key() + ".direction_rms", row.direction, "deg"});
    result.numbers.push_back({row.key() + ".torque_rms", row.torque, "%"});
    result.numbers.push_back({row.key() + ".jump_ratio", row.jump, "1"});
    result.numbers.push_back({row.key() + ".median", 1e6 * row.times.median, "µs"});
    result.numbers.push_back({row.key() + ".p99", 1e6 * row.times.p99, "µs"});
  }
  for (std::size_t v = 0; v < std::size(titles); ++v) {
    Plot plot{titles[v], "distance, count, square, gaussian, agreement, path", labels[v], {}, false,
              true,      "To simplified square and gaussian are the distance."};
    Curve weighted{"weighted", "weighted", {}, {}}, simplified{"simplified", "simplified", {}, {}};
    for (const Row& row : rows) {
      Curve& curve = row.options.method == MethodKind::weighted ? weighted : simplified;
      curve.x.push_back(1 + static_cast<double>(row.options.priority));
      curve.y.push_back(value_of(row, v));
    }
    plot.curves = {std::move(weighted), std::move(simplified)};
    result.plots.push_back(std::move(plot));
  }
  result.tables.push_back(std::move(table));
  // Better by over a tenth in one of the three, and worse in none.
  for (const MethodKind method : {MethodKind::weighted, MethodKind::simplified}) {
    const auto is_of_method = [&](const Row& row) { return row.options.method == method; };
    const Row& base = *std::find_if(rows.begin(), rows.end(), is_of_method);
    std::string better;
    int num_better = 0;
    for (const Row& row : rows) {
      if (!is_of_method(row)) continue;
      const Verdict verdict = is_better_in_all({is_better(row.volume, base.volume),
                                                is_better(row.direction, base.direction),
                                                is_better(row.jump, base.jump)});
      if (verdict != Verdict::better) continue;
      better += (better.empty() ? "" : ", ") + row.priority();
      ++num_better;
    }
    result.claims.push_back(
        {words("No other priority makes %s better: in volume, direction or smoothness by over a "
               "tenth, and worse in none.",
               base.method.c_str()),
         words("With the distance %.2f %%, %.2f° and %.1f times the exact step; better: %s.",
               base.volume, base.direction, base.jump, better.empty() ? "none" : better.c_str()),
         holds_up_to(num_better, 0), Source::docs});
  }
  result.notes.push_back(
      words("On %zu pairs that are tilted and off the axis, %d spheres whose volumes sum to the "
            "mesh; times of the first pair, 10 to 30 %% deep, one thread. Figures 3.4 and 3.5 show "
            "the number of points as a priority with a hand.",
            cases.size(), context.choose(kSpheres, 300)));
  return result;
}

}  // namespace palpate::eval
