// priorities: what else could make a boundary sphere a good one to take a plane from (an open
// question of the thesis, sections 3.2.2 and 6): errors and smoothness by each priority, against
// the exact wrench.
#include <algorithm>
#include <chrono>
#include <cmath>

#include "eval/assignment.h"
#include "eval/context.h"
#include "eval/option_figures.h"
#include "eval/parallel.h"
#include "eval/speed.h"
#include "eval/verdict_rules.h"

namespace palpate::eval {
namespace {

constexpr int kSpheres = 1000;

struct Row {
  std::string method, key, priority;
  bool is_average = true;
  AssignPriority by = AssignPriority::distance;
  double volume = 0, direction = 0, torque = 0;  ///< % rms, degrees rms, % rms
  double jump = 0;                               ///< exact = 1, rms over the scenes
  double seconds = 0;                            ///< of a query, here
};

std::vector<Row> all_rows() {
  constexpr const char* kKeys[] = {"distance", "square",    "fourth",
                                   "gaussian", "agreement", "along"};
  std::vector<Row> rows;
  for (std::size_t p = 0; p < std::size(kKeys); ++p) {
    const auto by = static_cast<AssignPriority>(p);
    rows.push_back({"weighted", words("weighted.%s", kKeys[p]), name_of(by), true, by});
  }
  for (const auto by :
       {AssignPriority::distance, AssignPriority::agreement, AssignPriority::along}) {
    rows.push_back(
        {"simplified", words("simplified.%s", kKeys[static_cast<std::size_t>(by)]),
         by == AssignPriority::distance ? "nearest (1 / d, 1 / d², Gaussian)" : name_of(by), false,
         by});
  }
  return rows;
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
              const SeenScene seen = see(cases[i], DepthNoise::gaussian);
              const auto coarse = exact_steps(cases[i], tool, 0, 1, num_coarse);
              // Of 0.05 mm, a tick at 50 mm/s.
              const double fine = num_fine / static_cast<double>(num_steps_over(cases[i], 1, 5e-5));
              const auto steps = exact_steps(cases[i], tool, 0.3, 0.3 + fine, num_fine);
              for (Row& row : by_case[i]) {
                const Measure measure = assignment_measure(tool, seen, row.by, row.is_average);
                const auto start = std::chrono::steady_clock::now();
                row.volume = volume_error(tool, coarse, measure).rms;
                const std::chrono::duration<double> took = std::chrono::steady_clock::now() - start;
                row.seconds = took.count() / static_cast<double>(coarse.size());
                const WrenchError wrench = wrench_error(tool, coarse, measure);
                row.direction = wrench.direction_rms, row.torque = wrench.torque_rms;
                row.jump = wrench_error(tool, steps, measure).jump_ratio();
                work.step();
              }
            });
  const auto n = static_cast<double>(cases.size());
  for (std::size_t r = 0; r < rows.size(); ++r) {
    Row sum;
    for (const auto& of_case : by_case) {
      sum.volume += of_case[r].volume * of_case[r].volume / n;
      sum.direction += of_case[r].direction * of_case[r].direction / n;
      sum.torque += of_case[r].torque * of_case[r].torque / n;
      sum.jump += of_case[r].jump * of_case[r].jump / n;
      rows[r].seconds += of_case[r].seconds;
    }
    rows[r].volume = 100 * std::sqrt(sum.volume), rows[r].torque = 100 * std::sqrt(sum.torque);
    rows[r].direction = 180 / kPi * std::sqrt(sum.direction), rows[r].jump = std::sqrt(sum.jump);
  }
  FigureResult result;
  Table table{"By priority, 1.5 mm noise",
              {"method", "priority", "volume, % rms", "direction, ° rms", "torque, % rms",
               "largest step, exact = 1", "time of the reference, 1 / d = 1"},
              {}};
  const char* titles[] = {"Volume", "Direction", "Smoothness"};
  const char* labels[] = {"error, % rms", "error, ° rms", "largest step, exact = 1"};
  double Row::*const values[] = {&Row::volume, &Row::direction, &Row::jump};
  for (const Row& row : rows) {
    table.rows.push_back({row.method, row.priority, words("%.2f", row.volume),
                          words("%.2f", row.direction), words("%.2f", row.torque),
                          words("%.1f", row.jump),
                          words("%.1f", row.seconds / rows[row.is_average ? 0 : 6].seconds)});
    result.numbers.push_back({row.key + ".volume_rms", row.volume, "%"});
    result.numbers.push_back({row.key + ".direction_rms", row.direction, "deg"});
    result.numbers.push_back({row.key + ".torque_rms", row.torque, "%"});
    result.numbers.push_back({row.key + ".jump_ratio", row.jump, "1"});
  }
  for (std::size_t v = 0; v < 3; ++v) {
    Plot plot{
        titles[v],
        "1/d, 1/d², 1/d⁴, Gaussian, agreement, graph",
        labels[v],
        {},
        false,
        true,
        "Simplified at the places of 1/d, agreement and graph; the first three are one there."};
    Curve weighted{"weighted", "weighted", {}, {}}, simplified{"simplified", "simplified", {}, {}};
    for (const Row& row : rows) {
      Curve& curve = row.is_average ? weighted : simplified;
      curve.x.push_back(1 + static_cast<double>(row.by)), curve.y.push_back(row.*values[v]);
    }
    plot.curves = {std::move(weighted), std::move(simplified)};
    result.plots.push_back(std::move(plot));
  }
  result.tables.push_back(std::move(table));
  // Better by over a tenth in one of the three, and worse in none.
  const auto improves = [&](std::size_t r) {
    const Row& base = rows[rows[r].is_average ? 0 : 6];
    return is_better_in_all({is_better(rows[r].volume, base.volume),
                             is_better(rows[r].direction, base.direction),
                             is_better(rows[r].jump, base.jump)}) == Verdict::better;
  };
  for (const bool is_average : {true, false}) {
    std::string better;
    for (std::size_t r = 0; r < rows.size(); ++r) {
      if (rows[r].is_average != is_average || !improves(r)) continue;
      better += (better.empty() ? "" : ", ") + rows[r].priority;
    }
    const Row& base = rows[is_average ? 0 : 6];
    result.claims.push_back(
        {words("No other priority makes %s better: in volume, direction or smoothness by over a "
               "tenth, and worse in none.",
               is_average ? "weighted" : "simplified"),
         words("With the distance %.2f %%, %.2f° and %.1f times the exact step; better: %s.",
               base.volume, base.direction, base.jump, better.empty() ? "none" : better.c_str()),
         better.empty() ? Verdict::holds : Verdict::fails});
  }
  result.notes.push_back(words(
      "Measured by a reference in double (Algs. 3.3 and 3.4 with any priority, volumes that "
      "sum to the mesh) on %zu pairs that are tilted and off the axis, %d spheres; the "
      "program itself has distance and count. The number of points as a priority: figures "
      "3.4 and 3.5. Times are of this reference and tell no more than what the formula costs.",
      cases.size(), context.choose(kSpheres, 300)));
  return result;
}

}  // namespace palpate::eval
