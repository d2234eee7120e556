// corners: two edges under the tool at once, and the corner of a box (thesis sections 3.5 and 6,
// which leave both open). Seen from the camera, the object and the space that it hides are the
// solid behind its front and behind planes of sight along its edges, so the volume is known
// exactly.
#include <algorithm>
#include <cmath>

#include "eval/figures/option_figures.h"
#include "eval/studies/interaction.h"
#include "eval/studies/pillar.h"
#include "eval/studies/speed.h"
#include "eval/studies/verdict_rules.h"
#include "scenes/body_shapes.h"
#include "scenes/truth.h"

namespace palpate::eval {
namespace {

constexpr int kSpheres = 2000;
constexpr double kFront = 1;       // m: z of the front
constexpr double kPost = 0.05;     // m: the width of the post
constexpr double kCorner = 0.06;   // m: x and -y of the corner of the box
constexpr double kDepthOf = 0.25;  // m: of both

const Plane<double> kFrontPlane{{0, 0, -1}, -kFront};

/// Returns the plane through the camera and the front's edge at x (or y), with outward normal.
Plane<double> sight_plane(const Vec3d& axis, double at) {
  const Vec3d outwards = at < 0 ? -1.0 * axis : axis;
  return {normalized(kFront * outwards - std::abs(at) * Vec3d{0, 0, 1}), 0};
}

/// An object to scrape past, and the exact volume of a tool in and behind it.
struct Thing {
  const char *key, *name;
  scenes::Scene scene;
  Vec3d from, to;  ///< of the middle of the tool
  double (*exact)(const TriangleMesh& tool, const Pose& X_WT);
};

double behind_post(const TriangleMesh& tool, const Pose& X_WT) {
  const Plane<double> right = sight_plane({1, 0, 0}, kPost / 2),
                      left = sight_plane({1, 0, 0}, -kPost / 2);
  const auto beyond = [&](const Plane<double>& edge, double x) {
    const Plane<double> planes[] = {kFrontPlane, {-1.0 * edge.normal, -edge.offset}};
    return scenes::exact_volume(tool, X_WT, Vec3d{x, 0, kFront}, planes);
  };
  // The regions beyond the two edges are disjoint.
  return scenes::exact_volume(tool, X_WT, Vec3d{0, 0, kFront}, {&kFrontPlane, 1}) -
         beyond(right, kPost / 2) - beyond(left, -kPost / 2);
}

double behind_corner(const TriangleMesh& tool, const Pose& X_WT) {
  const Plane<double> planes[] = {kFrontPlane, sight_plane({1, 0, 0}, kCorner),
                                  sight_plane({0, 1, 0}, -kCorner)};
  return scenes::exact_volume(tool, X_WT, Vec3d{kCorner, -kCorner, kFront}, planes);
}

scenes::Scene scene_of(TriangleMesh object) {
  scenes::Scene scene;
  scene.bodies.push_back({"wall", scenes::block({-4, -3, 2.4}, {4, 3, 2.5}), nullptr, {}});
  scene.bodies.push_back({"object", std::move(object), nullptr, {}});
  return scene;
}

std::vector<Thing> all_things() {
  return {{"post",
           "a post of 5 cm: two edges at once",
           scene_of(scenes::block({-kPost / 2, -1, kFront}, {kPost / 2, 1, kFront + kDepthOf})),
           {-0.09, 0.01, kFront + 0.005},
           {0.09, -0.01, kFront + 0.005},
           behind_post},
          {"corner",
           "the corner of a box",
           scene_of(scenes::block({-0.4, -kCorner, kFront}, {kCorner, 0.4, kFront + kDepthOf})),
           {kCorner - 0.07, -kCorner + 0.06, kFront + 0.005},
           {kCorner + 0.06, -kCorner - 0.07, kFront + 0.005},
           behind_corner}};
}

constexpr Edges kEdges[] = {Edges::none, Edges::cut};

}  // namespace

Result<FigureResult> figure_corners(Context& context) {
  const std::vector<Thing> things = all_things();
  const auto tool = pillar_box(context, context.choose(kSpheres, 300));
  if (!tool) return tool.error();
  const Quaternion tilted = axis_angle({0.3, 1, 0.2}, 20 * kPi / 180);
  FigureResult result;
  Table table{"Volume past two edges and a corner, rms error / largest step, % of the tool",
              {"what", "camera", "method", "no edges", "--edges cut"},
              {}};
  double none = 0, cut = 0, field = 0, best = INFINITY;  // % rms; the worst over things, with noise
  std::vector<Verdict> against_cut;
  const int num = context.choose(400, 40);
  for (std::size_t t = 0; t < things.size(); ++t) {
    const Thing& thing = things[t];
    std::vector<Pose> X_WT;
    std::vector<double> exact;
    for (int i = 0; i <= num; ++i) {
      const Vec3d middle = thing.from + (static_cast<double>(i) / num) * (thing.to - thing.from);
      X_WT.push_back({middle, tilted});
      exact.push_back(thing.exact((*tool)->mesh(), X_WT.back()) / (*tool)->mesh_mass().volume);
    }
    Plot plot{words("Volume past %s, Kinect noise", thing.name),
              "share of the way, %",
              "volume, % of the tool",
              {},
              false,
              false,
              ""};
    const auto add_curve = [&](std::string name, const char* style,
                               const std::vector<double>& volumes) {
      Curve curve{std::move(name), style, {}, {}};
      for (std::size_t i = 0; i < volumes.size(); ++i) {
        curve.x.push_back(100 * static_cast<double>(i) / num);
        curve.y.push_back(100 * volumes[i]);
      }
      plot.curves.push_back(std::move(curve));
    };
    add_curve("exact", "exact", exact);
    for (const bool with_noise : {false, true}) {
      const auto frame = seen_scene(context, thing.scene, with_noise);
      if (!frame) return frame.error();
      auto query = query_on(*frame, **tool);
      const char* camera = with_noise ? "Kinect noise" : "exact";
      double field_here = 0, best_here = INFINITY;
      for (const Method& method : all_methods_alike()) {
        const bool is_field = method.options.method == MethodKind::field;
        std::vector<std::string> row{thing.name, camera, method.name};
        for (const Edges edges : kEdges) {
          if (is_field && edges != Edges::none) continue;
          ContactOptions options = method.options;
          options.edges = edges;
          const auto volumes = measured_volumes(*query, **tool, X_WT, options);
          const WayError error = way_error(volumes, exact);
          const double rms = 100 * error.rms;
          row.push_back(words("%.1f / %.1f", rms, 100 * error.largest_step));
          const std::string key = words("%s.%s.%s.%s.", thing.key, with_noise ? "noise" : "exact",
                                        method.name, name_of(edges).c_str());
          result.numbers.push_back({key + "rms", rms, "%"});
          result.numbers.push_back({key + "step", 100 * error.largest_step, "%"});
          if (is_field) field_here = rms;
          if (!is_field) best_here = std::min(best_here, rms);
          if (!with_noise) continue;
          if (is_field) field = std::max(field, rms);
          if (!is_field && edges == Edges::none) none = std::max(none, rms);
          if (edges == Edges::cut) cut = std::max(cut, rms);
          if (is_field) add_curve("field", "field", volumes);
          if (std::string(method.name) == "simplified") {
            add_curve(edges == Edges::cut ? "simplified, edges cut" : "simplified",
                      edges == Edges::cut ? "other1" : "simplified", volumes);
          }
        }
        row.resize(table.columns.size());
        table.rows.push_back(std::move(row));
      }
      against_cut.push_back(is_better(field_here, best_here));
      best = std::min(best, best_here);
      context.progress((static_cast<double>(t) + 0.5 * (with_noise + 1)) /
                       static_cast<double>(things.size()));
    }
    plot.caption = words(
        "Worst of the thesis' methods so far: %.1f %% rms without edge planes, "
        "%.1f %% cut by them; field %.1f %%.",
        none, cut, field);
    result.plots.push_back(std::move(plot));
  }
  result.claims.push_back(
      {"Edge planes that cut every sphere stay right where two edges are under the tool at once, "
       "and at a corner: at most half the error without them.",
       words("At most %.1f %% of the tool rms with Kinect noise, without edge planes %.1f %%.", cut,
             none),
       holds_below(2 * cut, none, 2 * none), Source::docs});
  result.claims.push_back(
      {"Past two edges and corners the field is nearer to the exact volume than any method of the "
       "thesis, with edge planes or without.",
       words(
           "At most %.1f %% of the tool rms with Kinect noise; the best of the others at best %.1f "
           "%%.",
           field, best),
       is_better_in_all(against_cut), Source::ours});
  result.tables.push_back(std::move(table));
  result.notes.push_back(
      words("A cube of 8 cm with %d spheres, tilted by 20 degrees, about half inside, goes across "
            "the post, and from the front of the box out over its corner.",
            context.choose(kSpheres, 300)));
  return result;
}

}  // namespace palpate::eval
