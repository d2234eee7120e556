// eighth: the thesis' advice for the stiffness, the device's largest force at an eighth of the
// tool's volume (section 4.1): penetration depth of a hand, and the resulting stiffness.
#include <algorithm>
#include <cmath>

#include "eval/figures/option_figures.h"
#include "eval/studies/accuracy.h"
#include "eval/studies/interaction.h"
#include "eval/studies/speed.h"
#include "eval/studies/verdict_rules.h"

namespace palpate::eval {
namespace {

constexpr double kLargest = 10;                  // N, of the thesis' device
constexpr double kHands[] = {100, 300, 1000};    // N/m: relaxed to firm
constexpr double kSizes[] = {0.04, 0.08, 0.16};  // m
constexpr const char* kShapes[] = {"box", "sphere", "torus", "needle"};
constexpr double kEighth = 0.125;

/// Returns the stiffness of a tool, N per m3.
double volume_stiffness(double whole) { return kLargest / (kEighth * whole); }

/// Returns the share of the tool that is inside where the spring of a hand with the goal X_WT
/// balances the contact force.
double share_at_rest(MethodQueries& query, const Tool& tool, const ContactOptions& options,
                     const Pose& X_WT, double hand) {
  const double whole = full_volume(tool, options), k = volume_stiffness(whole);
  const Penetration desired = query.query(X_WT, options);
  if (desired.volume == 0) return 0;
  const Vec3d out = normalized(desired.measure_W.force);
  double low = 0, high = 0.2;
  for (int i = 0; i < 24; ++i) {
    const double way = (low + high) / 2;
    const Pose X{X_WT.translation + way * out, X_WT.rotation};
    const double push = k * dot(query.query(X, options).measure_W.force, out);
    // The force of a device is limited.
    (std::min(push, kLargest) > hand * way ? low : high) = way;
  }
  return query.query({X_WT.translation + low * out, X_WT.rotation}, options).volume / whole;
}

/// Returns the largest stiffness on a wall until an eighth is inside, N/m.
Result<double> wall_stiffness(Context& context, const char* shape, double size,
                              const RenderedScene& wall) {
  const auto tool = context.tool(shape, size, context.choose(2000, 300));
  if (!tool) return tool.error();
  const auto query = make_contact_query(palpate::Place::cpu(), **tool);
  if (!query) return query.error();
  const double whole = full_volume(**tool, ContactOptions{});
  double most = 0;
  const SurfaceView surface{wall.surface.cloud(), wall.field.view()};
  for (double z = 1 - size; z < 1 + size; z += size / 200) {
    const ContactResult at = (*query)->measure(surface, {{0, 0, z}, {}}, {.stiffness = true});
    if (at.penetration.volume > kEighth * whole) break;
    most = std::max(most, volume_stiffness(whole) * at.stiffness->m[2][2]);
  }
  return most;
}

}  // namespace

Result<FigureResult> figure_eighth(Context& context) {
  const auto scene = hand_interaction(context);
  if (!scene) return scene.error();
  const auto tool = context.thesis_tool(scene->shape, scene->size, context.choose(2000, 300));
  if (!tool) return tool.error();
  // A hand whose path goes in by half of the tool.
  const auto path = hand_path(scene->frame, **tool, 0.5, context.choose<std::size_t>(400, 40), 0.4,
                              scene->motion, scene->farthest);
  if (!path) return path.error();
  auto query = query_on(scene->frame, **tool);
  FigureResult result;
  Table table{"Penetration at the balance of hand and contact, % of the tool (mean / most)",
              {"hand, N/m"},
              {}};
  const auto methods = all_methods_alike();
  for (const Method& method : methods) table.columns.emplace_back(method.name);
  Plot plot{"How deep a hand goes",
            "stiffness of the hand, N/m",
            "of the tool inside, %, mean",
            {},
            true,
            false,
            ""};
  for (const Method& method : methods) plot.curves.push_back({method.name, method.name, {}, {}});
  double largest[std::size(kHands)] = {};  // mean of the methods of the thesis
  for (const double hand : kHands) {
    std::vector<std::string> row{words("%.0f", hand)};
    for (std::size_t m = 0; m < methods.size(); ++m) {
      double mean = 0, most = 0;
      for (const Pose& X_WT : path->X_WT) {
        const double share = share_at_rest(*query, **tool, methods[m].options, X_WT, hand);
        mean += share / static_cast<double>(path->X_WT.size());
        most = std::max(most, share);
      }
      row.push_back(words("%.1f / %.1f", 100 * mean, 100 * most));
      plot.curves[m].x.push_back(hand), plot.curves[m].y.push_back(100 * mean);
      result.numbers.push_back({words("%s.%.0f.mean", methods[m].name, hand), 100 * mean, "%"});
      result.numbers.push_back({words("%s.%.0f.most", methods[m].name, hand), 100 * most, "%"});
      if (methods[m].options.method != MethodKind::field) {
        double& largest_mean = largest[table.rows.size()];
        largest_mean = std::max(largest_mean, mean);
      }
    }
    table.rows.push_back(std::move(row));
    context.progress(0.3 * static_cast<double>(table.rows.size()));
  }
  plot.caption = words(
      "A hand of 100, 300 and 1000 N/m that means to be half inside (%.0f %% on average) is "
      "held at %.1f, %.1f and %.1f %% at most on average.",
      100 * path->mean_depth, 100 * largest[0], 100 * largest[1], 100 * largest[2]);
  result.claims.push_back(
      {"At 1/8 stiffness the average penetration stays below 12.5 %.", plot.caption,
       are_true({largest[0] < kEighth, largest[1] < kEighth, largest[2] < kEighth})});
  const RenderedScene wall = see(at_the_wall(thesis_cases().front()), DepthNoise::none);
  Table stiffness{"Stiffness on a wall with 10 N at an eighth, N/m", {"tool"}, {}};
  for (const double size : kSizes) stiffness.columns.push_back(words("%.0f cm", 100 * size));
  std::vector<double> all;
  for (const char* shape : kShapes) {
    std::vector<std::string> row{shape};
    for (const double size : kSizes) {
      const auto k = wall_stiffness(context, shape, size, wall);
      if (!k) return k.error();
      row.push_back(words("%.0f", *k));
      all.push_back(*k);
      result.numbers.push_back({words("%s.%.0f_cm.stiffness", shape, 100 * size), *k, "N/m"});
    }
    stiffness.rows.push_back(std::move(row));
  }
  const auto [least, most] = std::minmax_element(all.begin(), all.end());
  result.claims.push_back(
      {"The advice suits tools of every size: the rendered stiffness of a wall is the same, within "
       "a factor of 2.",
       words("%.0f to %.0f N/m: it goes with the force over the tool's length, and with its shape.",
             *least, *most),
       holds_below(*most, 2 * *least), Source::docs});
  result.plots.push_back(std::move(plot));
  result.tables.push_back(std::move(table));
  result.tables.push_back(std::move(stiffness));
  result.notes.push_back(
      scene->name +
      ". The hand is a spring from where it means to be to where the tool is, without inertia; the "
      "device gives 10 N at most. The stiffness is that of the field along the wall's normal, its "
      "largest until an eighth is inside; a device bears K < 2 b / T of it.");
  return result;
}

}  // namespace palpate::eval
