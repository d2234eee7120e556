// 5.17-5.29: a tool goes straight into a solid that is known exactly (thesis section 5.1.2). The
// exact force is drawn beside every method, without noise and with 1.5 mm of it.
#include <algorithm>
#include <cmath>
#include <optional>
#include <utility>

#include "eval/context.h"
#include "eval/studies/accuracy.h"
#include "eval/studies/speed.h"
#include "eval/studies/verdict_rules.h"

namespace palpate::eval {
namespace {

constexpr int kSpheres = 1000;      // as in the thesis
constexpr double kOffAxis = 0.01;   // of the whole tool's force: the line width of a plot
constexpr double kWrong = 0.03;     // of the whole tool's force: clearly off the line
constexpr double kNearDepth = 15;   // % of the travel: as claimed
constexpr double kNearLine = 0.03;  // rms, of the tool's volume
constexpr int kLoopSteps = 2000;

/// Claimed finding of a figure.
enum class Finding {
  near_line,    ///< close to the exact curve at all depths
  off_axis,     ///< a false sideways force appears at `depth`
  right_until,  ///< close to the exact curve up to `depth`
};
struct Scene {
  const char* id;  ///< and ThesisExperiment::figure
  const char* title;
  Finding finding;
  double depth;  ///< % of the travel; 0: no depth is claimed
  const char* claim;
};
constexpr Scene kScenes[] = {
    {"5.18", "Cube into a wall", Finding::near_line, 0,
     "A straight line from 0 to 100 % with rounded ends."},
    {"5.19", "Octahedron into a wall", Finding::near_line, 0,
     "A smooth S-shaped curve, as the octahedron's volume goes."},
    {"5.21", "Cube leaving a large ball (inside, 480 px)", Finding::near_line, 0,
     "Near the line, slight noise on x and y, irregular at the end."},
    {"5.22", "Cube leaving a medium ball (inside, 320 px)", Finding::near_line, 0,
     "Near the line, slight noise on x and y, irregular at the end."},
    {"5.20a", "Cube onto a large ball (outside, 480 px)", Finding::near_line, 0,
     "Much like a wall."},
    {"5.23", "Cube onto a medium ball (outside, 320 px)", Finding::right_until, 75,
     "Wrong x and y late; near the line to about 75 %."},
    {"5.24", "Cube onto a small ball (outside, 160 px)", Finding::right_until, 75,
     "Much false x and y late; near the line to about 75 %."},
    {"5.25", "Cube leaving a small ball (inside, 160 px)", Finding::near_line, 0, "No big errors."},
    {"5.27", "Tetrahedron into a blunt corner (225°)", Finding::off_axis, 80,
     "False x volume appears above 80 %."},
    {"5.26d", "Tetrahedron into a sharp corner (270°)", Finding::off_axis, 0,
     ""},  // a setup without a curve
    {"5.28", "Tetrahedron onto a blunt ridge (135°)", Finding::off_axis, 60,
     "False x volume appears above 60 %."},
    {"5.29", "Tetrahedron onto a sharp ridge (90°)", Finding::off_axis, 45,
     "False x volume appears above 45 %."},
};

/// Results of one method on the way through a scene; forces in shares of the whole tool's force.
struct Way {
  std::vector<double> along, sideways, error;  ///< against -z; across it; |force - exact|
  VolumeError volume;
  WrenchError wrench;
};

struct Ways {
  std::vector<double> depth;  ///< % of the travel
  std::vector<double> along;  ///< exact
  std::vector<Way> methods;   ///< as all_methods_alike()
  VolumeError graph_of_pack;  ///< with the gap rule of our packings
};

/// The tool with the thesis' leaf graph, and with that of our packings.
struct Tools {
  std::shared_ptr<const Tool> thesis, of_pack;
};

Ways measure(const ContactCase& c, const Tools& tools, DepthNoise noise, int num_steps) {
  const Tool& tool = *tools.thesis;
  const RenderedScene scene = see(c, noise);
  const auto steps = exact_steps(c, tool, 0, 1, num_steps);
  const double whole = tool.mesh_mass().volume;
  Ways ways;
  for (const ExactStep& step : steps) {
    ways.depth.push_back(100 * step.depth);
    ways.along.push_back(-100 * step.exact.measure_C_W.force.z / whole);
  }
  for (const Method& method : all_methods_alike()) {
    const Measure measured = query_measure(tool, scene, method.options);
    Way way;
    for (const ExactStep& step : steps) {
      const Vec3d f = measured.at(step.X_WT).measure_W.force / measured.whole;
      const Vec3d exact = step.exact.measure_C_W.force / whole;
      way.along.push_back(-100 * f.z);
      way.sideways.push_back(100 * std::hypot(f.x, f.y));
      way.error.push_back(norm(f - exact));  // lost contact is an error, too
    }
    way.volume = volume_error(tool, steps, measured);
    way.wrench = wrench_error(tool, steps, measured);
    ways.methods.push_back(std::move(way));
  }
  const Method graph = all_methods_alike()[2];
  ways.graph_of_pack =
      volume_error(tool, steps, query_measure(*tools.of_pack, scene, graph.options));
  return ways;
}

/// Returns the first depth at which a curve (in %) lies above `limit` (share); NaN: never.
double first_above(const std::vector<double>& depth, const std::vector<double>& share,
                   double limit) {
  for (std::size_t i = 0; i < depth.size(); ++i) {
    if (share[i] > limit) return depth[i];
  }
  return std::nan("");
}

std::vector<double> shares(const std::vector<double>& percent) {
  std::vector<double> result;
  for (const double x : percent) result.push_back(x / 100);
  return result;
}

std::string depth_words(double depth) {
  return std::isfinite(depth) ? words("from %.0f %% of the way on", depth) : std::string("never");
}

/// Returns the error with lost contact included: rms, share of the tool.
double whole_error(const VolumeError& error) {
  const double kept = error.rms * error.rms * (1 - error.lost);
  return std::sqrt(kept + error.worst_lost * error.worst_lost * error.lost);
}

std::string lost_words(const Way& way) {
  return way.volume.lost > 0
             ? words(" (contact lost in %.1f %% of the steps)", 100 * way.volume.lost)
             : std::string();
}

/// Judges the claim about the thesis' methods, and compares ours with them against the exact curve.
std::vector<Claim> judge(const Scene& scene, const Ways& clean) {
  const char* names[] = {"weighted", "simplified", "graph", "graph-cap", "field"};
  const Way& field = clean.methods[4];
  if (scene.finding == Finding::near_line) {
    std::vector<double> errors;
    std::string ours;
    for (std::size_t m = 0; m < 3; ++m) {
      errors.push_back(whole_error(clean.methods[m].volume));
      ours += words("%s%s %.2f %%%s", m == 0 ? "" : ", ", names[m], 100 * errors.back(),
                    lost_words(clean.methods[m]).c_str());
    }
    const double own = whole_error(field.volume);
    return {{scene.claim,
             words("Error of the volume, rms: %s, with the gap rule of our packings %.2f %%; near "
                   "is below %.0f %%.",
                   ours.c_str(), 100 * whole_error(clean.graph_of_pack), 100 * kNearLine),
             are_true({errors[0] < kNearLine, errors[1] < kNearLine, errors[2] < kNearLine})},
            {"The field is nearer to the exact curve than the best of the thesis' methods, all "
             "counting the same volumes.",
             words("Error of the volume %.2f %% rms%s, of the best of the others %.2f %%.",
                   100 * own, lost_words(field).c_str(), 100 * min_of(errors)),
             is_better(own, min_of(errors)), Source::ours}};
  }
  const bool is_error = scene.finding == Finding::right_until;
  std::vector<double> begins;
  std::string ours;
  for (std::size_t m = 0; m < 5; ++m) {
    if (m == 3) continue;
    const Way& way = clean.methods[m];
    begins.push_back(is_error ? first_above(clean.depth, way.error, kWrong)
                              : first_above(clean.depth, shares(way.sideways), kOffAxis));
    ours +=
        words("%s%s %s", ours.empty() ? "" : ", ", names[m], depth_words(begins.back()).c_str());
  }
  ours = (is_error ? "An error above 3 % of the whole force: "
                   : "A sideways force above 1 % of the whole: ") +
         ours + ".";
  // Counts "never" as later than the end of the way.
  const auto reached = [](double depth) { return std::isfinite(depth) ? depth : 110.0; };
  std::vector<Claim> claims;
  if (scene.depth > 0) {
    const double least = scene.depth - kNearDepth;
    claims.push_back({scene.claim, ours,
                      are_true({reached(begins[0]) >= least, reached(begins[1]) >= least,
                                std::isfinite(begins[0]) || std::isfinite(begins[1])})});
  }
  claims.push_back(
      {"The field is right for longer than the thesis' methods.", ours,
       is_better(std::max({reached(begins[0]), reached(begins[1]), reached(begins[2])}),
                 reached(begins[3])),
       Source::ours});
  return claims;
}

void add_plots(FigureResult& result, const Scene& scene, const Ways& ways, const char* noise) {
  Plot along{words("%s, %s", scene.title, noise),
             "depth, % of the travel",
             "force against the motion, % of the whole",
             {},
             false,
             false,
             ""};
  Plot sideways{words("Sideways, %s", noise),
                "depth, % of the travel",
                "force across the motion, % of the whole",
                {},
                false,
                false,
                ""};
  along.curves.push_back({"exact", "exact", ways.depth, ways.along});
  const auto methods = all_methods_alike();
  double least = INFINITY, most = 0;
  const char *best = "", *worst = "";
  for (std::size_t m = 0; m < methods.size(); ++m) {
    const Way& way = ways.methods[m];
    along.curves.push_back({methods[m].name, methods[m].name, ways.depth, way.along});
    sideways.curves.push_back({methods[m].name, methods[m].name, ways.depth, way.sideways});
    const double largest = *std::max_element(way.sideways.begin(), way.sideways.end());
    if (largest < least) least = largest, best = methods[m].name;
    if (largest > most) most = largest, worst = methods[m].name;
    const std::string key = words("%s.%s.", noise, methods[m].name);
    const auto add = [&](const char* name, double value, const char* unit) {
      result.numbers.push_back({key + name, value, unit});
    };
    add("volume_rms", 100 * way.volume.rms, "%");
    add("volume_worst", 100 * way.volume.worst, "%");
    add("lost", 100 * way.volume.lost, "% of the steps");
    add("direction_rms", way.wrench.direction_rms * 180 / kPi, "deg");
    add("torque_rms", 100 * way.wrench.torque_rms, "%");
    add("sideways_most", largest, "%");
  }
  along.caption =
      words("Volume rms of weighted and simplified %.2f to %.2f %%, of the field %.2f %%.",
            100 * std::min(ways.methods[0].volume.rms, ways.methods[1].volume.rms),
            100 * std::max(ways.methods[0].volume.rms, ways.methods[1].volume.rms),
            100 * ways.methods[4].volume.rms);
  sideways.caption = words("At most %.2f %% (%s) to %.2f %% (%s).", least, best, most, worst);
  result.plots.push_back(std::move(along));
  result.plots.push_back(std::move(sideways));
}

/// Adds the steps of the force in fine steps of the tool, and the net work of a closed loop.
void add_smoothness(FigureResult& result, Context& context, const ContactCase& c,
                    const Tool& tool) {
  Table table{
      "Smoothness: largest step of the force within 0.1 mm, exact = 1; net work of a closed "
      "loop, % of all work",
      {"method", "steps, no noise", "steps, noise", "loop, no noise", "loop, noise"},
      {}};
  const int num_steps = context.choose(num_steps_over(c, 0.3, 1e-4), 100);
  const int loop_steps = context.choose(kLoopSteps, 300);
  const RenderedScene scenes[] = {see(c, DepthNoise::none), see(c, DepthNoise::gaussian)};
  const auto steps = exact_steps(c, tool, 0.3, 0.6, num_steps);
  double field_jump = 0, worst_jump = 0, field_loop = 0, worst_loop = 0;
  double best_jump = INFINITY, best_loop = INFINITY;
  for (const Method& method : all_methods_alike()) {
    std::vector<std::string> row{method.name};
    double jumps[2], loops[2];
    for (int noisy = 0; noisy < 2; ++noisy) {
      const Measure measured = query_measure(tool, scenes[noisy], method.options);
      jumps[noisy] = wrench_error(tool, steps, measured).jump_ratio();
      loops[noisy] = 100 * loop_work(c, tool, measured, loop_steps);
      const std::string key = words("%s.%s.", noisy ? "noisy" : "clean", method.name);
      result.numbers.push_back({key + "jump_ratio", jumps[noisy], "1"});
      result.numbers.push_back({key + "loop_work", loops[noisy], "%"});
    }
    row.push_back(words("%.2f", jumps[0]));
    row.push_back(words("%.2f", jumps[1]));
    row.push_back(words("%.2g", loops[0]));
    row.push_back(words("%.2g", loops[1]));
    table.rows.push_back(std::move(row));
    if (method.options.method == MethodKind::field) {
      field_jump = jumps[1], field_loop = loops[1];
    } else {
      worst_jump = std::max(worst_jump, jumps[1]);
      worst_loop = std::max(worst_loop, loops[1]);
      best_jump = std::min(best_jump, jumps[1]);
      best_loop = std::min(best_loop, loops[1]);
    }
  }
  result.claims.push_back(
      {"The force of the field is smoother and gives less energy away than the thesis' methods do.",
       words(
           "With 1.5 mm of noise the field's largest step is %.2f times the exact one and a closed "
           "loop gives %.1g %% of the work away; of the thesis' methods %.2f to %.0f times and "
           "%.1g "
           "to %.1g %%.",
           field_jump, field_loop, best_jump, worst_jump, best_loop, worst_loop),
       is_better_in_all({is_better(field_jump, best_jump), is_better(field_loop, best_loop)}),
       Source::ours});
  result.tables.push_back(std::move(table));
}

Result<FigureResult> make_scene_figure(Context& context, const Scene& scene) {
  std::optional<ContactCase> found;
  for (const scenes::ThesisExperiment& x : scenes::thesis_experiments()) {
    if (x.figure != scene.id) continue;
    for (ContactCase& c : thesis_cases()) {
      if (c.scene == x.scene && c.tool_shape == x.tool_shape) found = std::move(c);
    }
  }
  if (!found) return Error{Errc::bad_input, std::string("no experiment for figure ") + scene.id};
  const auto tool = context.thesis_tool(found->tool_shape, found->tool_size, kSpheres);
  const auto of_pack = context.tool(found->tool_shape, found->tool_size, kSpheres);
  if (!tool) return tool.error();
  if (!of_pack) return of_pack.error();
  const Tools tools{*tool, *of_pack};
  const int num_steps = context.choose(201, 41);
  FigureResult result;
  const Ways clean = measure(*found, tools, DepthNoise::none, num_steps);
  context.progress(0.3);
  const Ways noisy = measure(*found, tools, DepthNoise::gaussian, num_steps);
  context.progress(0.6);
  result.claims = judge(scene, clean);
  result.numbers.push_back(
      {"graph.gap_rule_relative.volume", 100 * whole_error(clean.graph_of_pack), "%"});
  add_plots(result, scene, clean, "no noise");
  add_plots(result, scene, noisy, "1.5 mm noise");
  add_smoothness(result, context, *found, **tool);
  result.notes.push_back(
      "1,000 spheres, of which every method counts the volumes that they represent; forces in "
      "shares of what the wholly immersed tool gives. "
      "Exact: closed form for the mesh and the solid.");
  return result;
}

template <std::size_t kIndex>
Result<FigureResult> make(Context& context) {
  return make_scene_figure(context, kScenes[kIndex]);
}

template <std::size_t... kIndices>
std::vector<FigureSpec> specs(std::index_sequence<kIndices...>) {
  return {FigureSpec{kScenes[kIndices].id, kScenes[kIndices].title, "Quality", make<kIndices>}...};
}

}  // namespace

std::vector<FigureSpec> synthetic_figures() {
  return specs(std::make_index_sequence<std::size(kScenes)>{});
}

}  // namespace palpate::eval
