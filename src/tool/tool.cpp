#include "palpate/tool/tool.h"

#include <cmath>
#include <optional>
#include <utility>

namespace palpate {
namespace {

constexpr std::size_t kMaxSpheres = std::size_t(1) << 30;

Error bad(std::string message) { return {Errc::bad_input, std::move(message)}; }

template <class T>
bool is_finite(const Vec3<T>& v) {
  return std::isfinite(v.x) && std::isfinite(v.y) && std::isfinite(v.z);
}

/// What every tool keeps, however it was made.
std::optional<Error> check(const TriangleMesh& mesh, const SpherePacking& packing) {
  for (std::size_t i = 0; i < mesh.vertices.size(); ++i) {
    if (!is_finite(mesh.vertices[i]))
      return bad("vertex " + std::to_string(i) + " of the tool is not finite; repair the mesh");
  }
  for (std::size_t i = 0; i < mesh.triangles.size(); ++i) {
    for (const std::uint32_t corner : mesh.triangles[i]) {
      if (corner >= mesh.vertices.size())
        return bad("triangle " + std::to_string(i) + " of the tool names vertex " +
                   std::to_string(corner) + " of " + std::to_string(mesh.vertices.size()) +
                   "; repair the mesh");
    }
  }
  if (packing.spheres.empty()) return bad("a tool needs at least one sphere; pack the mesh first");
  if (packing.spheres.size() > kMaxSpheres)
    return bad("a tool can have 2^30 spheres at most; pack fewer");
  if (!std::isfinite(packing.mesh_volume) || packing.mesh_volume < 0)
    return bad("the volume of the tool is not a positive number; repair the mesh");
  for (std::size_t i = 0; i < packing.spheres.size(); ++i) {
    const Sphere& sphere = packing.spheres[i];
    if (!is_finite(sphere.centre) || !std::isfinite(sphere.radius) || !(sphere.radius > 0))
      return bad("sphere " + std::to_string(i) +
                 " of the tool is not finite or has no positive radius; pack the mesh again");
  }
  return std::nullopt;
}

/// Can every sphere be reached from sphere 0? A flood over the edges.
bool is_connected(const LeafGraph& graph, std::size_t num_spheres) {
  std::vector<char> seen(num_spheres, 0);
  std::vector<std::int32_t> waiting{0};
  seen[0] = 1;
  std::size_t num_seen = 1;
  while (!waiting.empty()) {
    const std::int32_t i = waiting.back();
    waiting.pop_back();
    for (std::int32_t k = graph.row_starts()[i]; k < graph.row_starts()[i + 1]; ++k) {
      const std::int32_t j = graph.neighbours()[k];
      if (seen[j]) continue;
      seen[j] = 1;
      ++num_seen;
      waiting.push_back(j);
    }
  }
  return num_seen == num_spheres;
}

}  // namespace

Result<Tool> Tool::build(TriangleMesh mesh, SpherePacking packing, GapRule rule,
                         std::string source) {
  // The graph needs spheres that passed the check.
  if (auto error = check(mesh, packing)) return *std::move(error);
  LeafGraph graph(packing.spheres, rule);
  return restore(std::move(mesh), std::move(packing), std::move(graph), std::move(source));
}

Result<Tool> Tool::restore(TriangleMesh mesh, SpherePacking packing, LeafGraph graph,
                           std::string source) {
  if (auto error = check(mesh, packing)) return *std::move(error);
  if (graph.row_starts().size() != packing.spheres.size() + 1)
    return bad("the tool's graph belongs to another number of spheres; build the tool again");
  if (!is_connected(graph, packing.spheres.size()))
    return bad("the tool's graph falls into several parts; build the tool again");

  Tool tool;
  tool.mesh_ = std::move(mesh);
  tool.packing_ = std::move(packing);
  tool.tree_ = InnerSphereTree(tool.packing_.spheres);
  tool.graph_ = std::move(graph);
  tool.sphere_mass_ = mass_properties(tool.packing_.spheres);
  tool.mesh_mass_ = mass_properties(tool.mesh_);
  tool.source_ = std::move(source);
  return tool;
}

}  // namespace palpate
