#include "palpate/tool/tool.h"

#include <cmath>
#include <optional>
#include <utility>

namespace palpate { inline namespace v0 {
namespace {

constexpr std::size_t kMaxSpheres = std::size_t(1) << 30;

Error bad(std::string message) { return {Errc::bad_input, std::move(message)}; }

template <class T>
bool is_finite(const Vec3<T>& v) {
  return std::isfinite(v.x) && std::isfinite(v.y) && std::isfinite(v.z);
}

/// Checks the conditions that every tool meets, however it was made.
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
    if (!is_finite(sphere.center) || !std::isfinite(sphere.radius) || !(sphere.radius > 0))
      return bad("sphere " + std::to_string(i) +
                 " of the tool is not finite or has no positive radius; pack the mesh again");
  }
  return std::nullopt;
}

/// Can every sphere be reached from sphere 0? A flood over the edges.
bool is_connected(const LeafGraph& graph, std::size_t num_spheres) {
  std::vector<char> seen(num_spheres, 0);
  std::vector<std::int32_t> waiting(num_spheres + 1);  // one to write to when all are there
  std::size_t num_seen = 1;
  seen[0] = 1;
  for (std::size_t next = 0; next < num_seen; ++next) {
    const std::int32_t i = waiting[next];
    for (std::int32_t k = graph.row_starts()[i]; k < graph.row_starts()[i + 1]; ++k) {
      const std::int32_t j = graph.neighbors()[k];
      waiting[num_seen] = j;  // stays if j is new: a branch would be mispredicted too often
      num_seen += seen[j] == 0;
      seen[j] = 1;
    }
  }
  return num_seen == num_spheres;
}

/// Checks that there is one part for each sphere, and that together they are the mesh. Rounding to
/// float moves the sum by less than 1e-6.
std::optional<Error> check_parts(const RepresentedParts& parts, std::size_t num_spheres,
                                 double mesh_volume) {
  double sum = 0;
  bool good = parts.volumes.size() == num_spheres && parts.balls.size() == num_spheres;
  for (const float volume : parts.volumes) {
    good = good && volume >= 0;
    sum += static_cast<double>(volume);
  }
  for (const Sphere& ball : parts.balls) {
    good = good && is_finite(ball.center) && std::isfinite(ball.radius) && ball.radius > 0;
  }
  if (good && std::abs(sum - mesh_volume) <= 1e-6 * mesh_volume) return std::nullopt;
  return bad(
      "the volumes that the tool's spheres represent are not its mesh; build the tool again");
}

}  // namespace

Result<Tool> Tool::pack(TriangleMesh mesh, const PackOptions& packing, ToolOptions options) {
  auto spheres = pack_spheres(mesh, packing);
  if (!spheres) return spheres.error();
  return build(std::move(mesh), *std::move(spheres), std::move(options));
}

Result<Tool> Tool::build(TriangleMesh mesh, SpherePacking packing, ToolOptions options) {
  // Graph and volumes need spheres that passed the check.
  if (auto error = check(mesh, packing)) return *std::move(error);
  LeafGraph graph(packing.spheres, options.gap_rule);
  if (graph.row_starts().empty())
    return bad("the spheres of the tool have more than " +
               std::to_string(LeafGraph::kMaxMeanNeighbors) +
               " neighbors on average: they overlap too much; pack the mesh again");
  ThreadPool pool(options.num_threads);
  auto represented = represented_parts(mesh, packing.spheres, pool);
  if (!represented) return represented.error();
  const InnerSphereTree tree(packing.spheres);
  StoredParts parts{std::move(graph),
                    options.gap_rule,
                    *std::move(represented),
                    {tree.nodes().begin(), tree.nodes().end()},
                    nullptr};
  return restore(std::move(mesh), std::move(packing), std::move(parts), std::move(options.source));
}

Tool Tool::with_solid_field(int num_threads) && {
  ThreadPool pool(num_threads);
  parts_.solid_field = std::make_shared<const SolidField>(SolidField::of(mesh_, pool));
  return std::move(*this);
}

Result<Tool> Tool::restore(TriangleMesh mesh, SpherePacking packing, StoredParts parts,
                           std::string source) {
  if (auto error = check(mesh, packing)) return *std::move(error);
  if (parts.graph.row_starts().size() != packing.spheres.size() + 1)
    return bad("the tool's graph belongs to another number of spheres; build the tool again");
  if (!is_connected(parts.graph, packing.spheres.size()))
    return bad("the tool's graph falls into several parts; build the tool again");
  const MassProperties mesh_mass = mass_properties(mesh);
  if (auto error = check_parts(parts.represented, packing.spheres.size(), mesh_mass.volume))
    return *std::move(error);
  auto tree = InnerSphereTree::restore(std::move(parts.tree_nodes), packing.spheres);
  if (!tree) return tree.error();

  Tool tool;
  tool.mesh_ = std::move(mesh);
  tool.packing_ = std::move(packing);
  tool.tree_ = *std::move(tree);
  tool.parts_ = std::move(parts);
  tool.sphere_mass_ = mass_properties(tool.packing_.spheres);
  tool.mesh_mass_ = mesh_mass;
  tool.source_ = std::move(source);
  return tool;
}

Result<Tool> Tool::prefix(int num_spheres, int num_threads) const {
  if (num_spheres < 1 || static_cast<std::size_t>(num_spheres) > spheres().size())
    return Error{Errc::invalid_argument,
                 "the tool has " + std::to_string(spheres().size()) + " spheres, " +
                     std::to_string(num_spheres) +
                     " were requested; use fewer, or pack the mesh with more"};
  const auto first = spheres().first(static_cast<std::size_t>(num_spheres));
  SpherePacking packing{{first.begin(), first.end()}, packing_.mesh_volume, PackStop::count};
  auto tool = build(mesh_, std::move(packing), {gap_rule(), source_, num_threads});
  if (tool) tool->parts_.solid_field = solid_field();
  return tool;
}

Result<Tool> Tool::thinned(int num_spheres, int num_threads) const {
  auto tool = prefix(num_spheres, num_threads);
  if (tool) tool->sphere_mass_.center_of_mass = sphere_mass_.center_of_mass;
  return tool;
}

}}  // namespace palpate::v0
