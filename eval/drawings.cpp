// 3.1, 3.2, 3.7, 3.8, 4.1, 4.4-4.8, 5.17, 5.20: drawings, and where this program shows the same.
#include <algorithm>
#include <cmath>

#include "eval/context.h"
#include "eval/figure.h"
#include "palpate/mesh/cap_mesh.h"
#include "palpate/mesh/mass_properties.h"
#include "scenes/truth.h"
#include "src/session/svg_parts.h"

namespace palpate::eval {
namespace {

constexpr int kFewSpheres = 500, kManySpheres = 5000;
constexpr double kToolSize = 0.1;  // m

/// A drawing has nothing to measure: it agrees if this program shows the same.
FigureResult shown(const std::string& thesis, const std::string& where) {
  FigureResult result;
  result.claims = {{thesis, where, Verdict::agrees}};
  return result;
}

Number count(const std::string& key, std::size_t value) {
  return {key, static_cast<double>(value), ""};
}

Result<FigureResult> pipeline(Context&) {
  return shown("The pipeline, from the depth image to the force (drawing).",
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
  FigureResult result =
      shown("The bunny, its inner spheres and the levels of its tree (pictures).",
            "A torus of " + std::to_string(num_spheres) + " spheres has a tree of " +
                std::to_string(nodes.size()) + " nodes in " + std::to_string(levels) +
                " levels; palpate pack --report shows any mesh cut open with its spheres.");
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
    const auto tool = context.tool("torus", kToolSize, num_spheres);
    if (!tool) return tool.error();
    const LeafGraph& graph = (*tool)->graph();
    const double num = static_cast<double>((*tool)->spheres().size());
    table.rows.push_back({short_number(num), std::to_string(graph.num_edges()),
                          short_number(2 * static_cast<double>(graph.num_edges()) / num, 3),
                          std::to_string(graph.num_components_before_bridging()),
                          std::to_string(graph.num_bridges())});
    result.numbers.push_back(
        count("edges." + std::to_string(num_spheres), static_cast<std::size_t>(graph.num_edges())));
  }
  const auto &few = table.rows.front(), &many = table.rows.back();
  result.claims = {{"How the leaf graph is made, and that of a bunny with few spheres (pictures).",
                    "A torus of " + few[0] + " spheres has " + few[1] + " edges, one of " +
                        many[0] + " has " + many[1] + "; palpate info tells them of any tool.",
                    Verdict::agrees}};
  result.tables = {std::move(table)};
  return result;
}

Result<FigureResult> threads(Context&) {
  return shown("Threads: camera, collision detection, haptic rendering and graphics (drawing).",
               "The same division, with surfaces and forces handed over without locks, is drawn in "
               "docs/guide/haptics.md.");
}

Result<FigureResult> states(Context&) {
  return shown(
      "The bunny in a wall and in a mannequin, spheres coloured by their state (pictures).",
      "palpate view shows them live; palpate query --caps FILE writes the volumes that "
      "the planes cut off as a coloured mesh.");
}

/// The example of Fig. 4.5, cut into the caps of Figs. 4.6 and 4.7.
Result<FigureResult> caps(Context&) {
  constexpr int kSegments = 64;
  const Sphere sphere{{3, 1, 2}, 3};
  const Vec3d on_plane{1.14, 1.1, 1.8}, normal = normalized(Vec3d{-0.52, 0.77, -0.36});
  const double distance = dot(normal, to_double(sphere.centre) - on_plane);
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
                          std::to_string(mesh.triangles.size()), short_number(volume, 6),
                          short_number(exact, 6)});
  }
  const bool meets = std::abs(distance)<radius, printed = std::abs(distance)> radius;
  result.claims = {
      {"Sphere and plane meet if |n S - n O| > r (the condition above eq. 4.20).",
       "In the thesis' own example |n S - n O| is " + short_number(std::abs(distance), 3) +
           " and r is 3; the plane cuts the sphere, so the condition has to be < r.",
       meets != printed ? Verdict::contradicts : Verdict::agrees},
      {"The cap before and the cap behind the plane as meshes (pictures).",
       "Both are closed; with " + std::to_string(kSegments) +
           " segments their volumes are those of the closed form within " +
           short_number(100 * worst, 2) + " %.",
       worst < 0.01 ? Verdict::agrees : Verdict::differs}};
  result.numbers = {{"distance", distance, ""}, {"cap.worst_volume_error", 100 * worst, "%"}};
  result.tables = {std::move(table)};
  return result;
}

Result<FigureResult> cap_algorithm(Context&) {
  return shown("One step of the drawing of caps, Alg. 4.1 (drawing).",
               "cap_mesh in mesh/cap_mesh.h is the algorithm, corrected.");
}

Result<FigureResult> set_ups(Context&) {
  FigureResult result;
  Table table{"The synthetic experiments", {"figure", "scene", "tool", "size, m", "way, m"}, {}};
  for (const scenes::ThesisExperiment& x : scenes::thesis_experiments()) {
    table.rows.push_back({x.figure, x.scene, x.tool_shape, short_number(x.tool_size),
                          short_number(norm(x.end.translation - x.start.translation))});
  }
  result.claims = {
      {"A wall, and spheres of 480, 320 and 160 pixels seen from outside and inside (set-ups).",
       "All " + std::to_string(table.rows.size()) +
           " set-ups are scenes with exact volumes and forces: palpate scenes.",
       Verdict::agrees}};
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
