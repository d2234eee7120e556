// 3.1, 3.2, 3.7, 3.8, 4.1, 4.4-4.8, 5.17, 5.20: drawings, and where this program shows the same.
#include <algorithm>
#include <cmath>

#include "eval/studies/interaction.h"
#include "eval/studies/speed.h"
#include "eval/studies/verdict_rules.h"
#include "palpate/mesh/mesh.h"
#include "scenes/truth.h"
#include "src/session/internal/page_models.h"

namespace palpate::eval {
namespace {

constexpr int kFewSpheres = 500, kManySpheres = 5000;
constexpr double kToolSize = 0.1;  // m

/// Makes a drawing of the thesis that this program shows elsewhere: no claim, no verdict.
FigureResult drawn_elsewhere(const std::string& thesis, const std::string& where) {
  FigureResult result;
  result.tables = {{"A drawing", {"in the thesis", "here"}, {{thesis, where}}}};
  return result;
}

Picture cut_open(const std::string& title, const Tool& tool, std::span<const Sphere> spheres,
                 const std::string& caption) {
  return {Picture::Kind::cut_open, title, solid_json(tool, spheres).dump(), caption};
}

Number count(const std::string& key, std::size_t value) {
  return {key, static_cast<double>(value), ""};
}

Result<FigureResult> pipeline(Context&) {
  return drawn_elsewhere(
      "The pipeline, from the depth image to the force.",
      "The way of a query is drawn in docs/architecture.md; every stage is one header.");
}

Result<FigureResult> tree_levels(Context& context) {
  const auto tool = context.tool("torus", kToolSize, context.choose(kManySpheres, kFewSpheres));
  if (!tool) return tool.error();
  const std::size_t num_spheres = (*tool)->spheres().size();
  const auto nodes = (*tool)->tree().nodes();
  int levels = 1;
  for (int node = static_cast<int>(nodes.size()) - 1; nodes[node].parent >= 0; ++levels) {
    node = nodes[node].parent;
  }
  FigureResult result;
  result.pictures.push_back(cut_open("The packing", **tool, (*tool)->spheres(),
                                     words("%zu spheres in a torus, cut open.", num_spheres)));
  // The spheres of the tree at some of its levels.
  std::vector<int> level_of(nodes.size(), 0);
  for (std::size_t i = 1; i < nodes.size(); ++i) {
    level_of[i] = level_of[static_cast<std::size_t>(nodes[i].parent)] + 1;
  }
  for (const int level : {levels / 3, 2 * levels / 3}) {
    std::vector<Sphere> spheres;
    for (std::size_t i = 0; i < nodes.size(); ++i) {
      if (level_of[i] == level) spheres.push_back(nodes[i].bound);
    }
    result.pictures.push_back(cut_open(words("Level %d of the tree", level), **tool, spheres,
                                       words("%zu bounding spheres.", spheres.size())));
  }
  result.tables = {
      {"The tree of inner spheres",
       {"spheres", "nodes", "levels"},
       {{std::to_string(num_spheres), std::to_string(nodes.size()), std::to_string(levels)}}}};
  result.numbers = {count("tree.spheres", num_spheres), count("tree.nodes", nodes.size()),
                    count("tree.levels", static_cast<std::size_t>(levels))};
  return result;
}

Result<FigureResult> leaf_graph(Context& context) {
  FigureResult result;
  Table table{"Leaf graphs of a torus of 0.1 m",
              {"spheres", "edges", "per sphere", "parts", "bridges"},
              {}};
  for (const int num_spheres : {100, kFewSpheres, context.choose(kManySpheres, 1000)}) {
    const auto tool = context.thesis_tool("torus", kToolSize, num_spheres);
    if (!tool) return tool.error();
    const LeafGraph& graph = (*tool)->graph();
    const double num = static_cast<double>((*tool)->spheres().size());
    table.rows.push_back({std::to_string((*tool)->spheres().size()),
                          std::to_string(graph.num_edges()),
                          words("%.3g", 2 * static_cast<double>(graph.num_edges()) / num),
                          std::to_string(graph.num_components_before_bridging()),
                          std::to_string(graph.num_bridges())});
    result.numbers.push_back(
        count("edges." + std::to_string(num_spheres), static_cast<std::size_t>(graph.num_edges())));
  }
  result.tables = {std::move(table)};
  return result;
}

Result<FigureResult> threads(Context&) {
  return drawn_elsewhere("Threads: camera, collision detection, haptic rendering and graphics.",
                         "The same division, with surfaces and forces handed over without locks: "
                         "docs/guide/haptics.md.");
}

/// Draws the tool at the deepest pose of a scene's path, its spheres by their state.
Result<Picture> states_in(Context& context, const char* name) {
  const auto scene = scenes::make_scene(name);
  if (!scene) return scene.error();
  const auto image = picture_of(context, *scene, true);
  if (!image) return image.error();
  const auto frame = FrozenFrame::create(image->stream, image->frame);
  if (!frame) return frame.error();
  const auto tool =
      context.tool(scene->tool_shape, scene->tool_size, context.choose(kManySpheres, kFewSpheres));
  if (!tool) return tool.error();
  auto query = query_on(*frame, **tool);
  Pose deepest;
  double most = 0;
  const std::size_t step = std::max<std::size_t>(1, scene->path_poses.size() / 200);
  for (std::size_t i = 0; i < scene->path_poses.size(); i += step) {
    const double share = query->query(scene->path_poses[i], ContactOptions{}).volume /
                         full_volume(**tool, ContactOptions{});
    if (share > most && share < 0.6) most = share, deepest = scene->path_poses[i];
  }
  query->query(deepest, ContactOptions{});
  return Picture{
      Picture::Kind::seen, words("In the scene %s", name),
      seen_tool_json(**tool, deepest, {&image->stream, 1}, {&image->frame, 1}, query->states(), {})
          .dump(),
      words("%.0f %% deep: inside blue, boundary purple, outside red.", 100 * most)};
}

Result<FigureResult> states(Context& context) {
  FigureResult result;
  for (const char* name : {"wall", "mannequin"}) {
    auto in_scene = states_in(context, name);
    if (!in_scene) return in_scene.error();
    result.pictures.push_back(*std::move(in_scene));
  }
  return result;
}

/// The example of Fig. 4.5, cut into the caps of Figs. 4.6 and 4.7.
Result<FigureResult> caps(Context&) {
  constexpr int kSegments = 64;
  const Sphere sphere{{3, 1, 2}, 3};
  const Vec3d on_plane{1.14, 1.1, 1.8}, normal = normalized(Vec3d{-0.52, 0.77, -0.36});
  const double distance = dot(normal, to_double(sphere.center) - on_plane);
  const double radius = sphere.radius, offset = dot(normal, on_plane);
  FigureResult result;
  Table table{"The two parts of the sphere",
              {"part", "triangles", "volume of the mesh", "closed form"},
              {}};
  double worst = 0;
  for (const double side : {1.0, -1.0}) {
    const TriangleMesh mesh = cap_mesh(sphere, {normal * side, offset * side}, kSegments);
    const double volume = mass_properties(mesh).volume;
    const double exact = cap_volume(radius, distance * side);
    worst = std::max(worst, std::abs(volume / exact - 1));
    table.rows.push_back({side > 0 ? "behind the plane" : "in front of it",
                          std::to_string(mesh.triangles.size()), words("%.6g", volume),
                          words("%.6g", exact)});
  }
  const bool meets = std::abs(distance)<radius, printed = std::abs(distance)> radius;
  result.claims = {
      {"Sphere and plane meet if |n S - n O| > r (the condition above eq. 4.20).",
       "In the thesis' own example |n S - n O| is " + words("%.3g", std::abs(distance)) +
           " and r is 3; the plane cuts the sphere, so the condition has to be < r.",
       are_true({meets == printed})},
      {"The caps before and behind the plane are closed meshes with the volumes of the closed "
       "form.",
       "With " + std::to_string(kSegments) +
           " segments their volumes are those of the closed form within " +
           words("%.2g", 100 * worst) + " %.",
       holds_below(worst, 0.01), Source::docs}};
  result.numbers = {{"distance", distance, ""}, {"cap.worst_volume_error", 100 * worst, "%"}};
  result.tables = {std::move(table)};
  return result;
}

Result<FigureResult> cap_algorithm(Context&) {
  return drawn_elsewhere("One step of the drawing of caps, Alg. 4.1.",
                         "cap_mesh in mesh/mesh.h is the algorithm, corrected.");
}

Result<FigureResult> set_ups(Context&) {
  FigureResult result;
  Table table{"The synthetic experiments", {"figure", "scene", "tool", "size, m", "way, m"}, {}};
  for (const scenes::ThesisExperiment& x : scenes::thesis_experiments()) {
    table.rows.push_back({x.figure, x.scene, x.tool_shape, words("%.4g", x.tool_size),
                          words("%.4g", norm(x.end.translation - x.start.translation))});
  }
  result.numbers = {count("setups", table.rows.size())};
  result.tables = {std::move(table)};
  return result;
}

constexpr const char* kSection = "Drawings";

}  // namespace

std::vector<FigureSpec> drawings() {
  return {{"3.1", "The pipeline", kSection, pipeline},
          {"3.2", "Inner spheres and their tree", kSection, tree_levels},
          {"3.7/3.8", "The leaf graph", kSection, leaf_graph},
          {"4.1", "Threads", kSection, threads},
          {"4.4", "Spheres by their state", kSection, states},
          {"4.5-4.7", "Caps of a sphere", kSection, caps},
          {"4.8", "How caps are drawn", kSection, cap_algorithm},
          {"5.17/5.20", "Set-ups of the synthetic experiments", kSection, set_ups}};
}

}  // namespace palpate::eval
