// A tool: its mesh, the spheres that fill it, their sphere tree and their leaf graph.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "palpate/core/core.h"
#include "palpate/math/geometry.h"
#include "palpate/mesh/mesh.h"
#include "palpate/packing/packing.h"

namespace palpate { inline namespace v0 {

// The wrapped inner sphere tree: leaves are the spheres of the packing, every inner node is a ball
// that contains all *leaves* below it (thesis section 3.1.1, Fig. 3.2c).

/// One node. Inner nodes have `num_children` contiguous children from `first_child` on; leaves have
/// num_children = 0 and a sphere_id.
struct IstNode {
  Sphere bound;
  std::int32_t first_child = -1;
  std::int32_t num_children = 0;
  std::int32_t sphere_id = -1;  ///< leaves: index into the packing
  std::int32_t parent = -1;     ///< -1 for the root
};

/// Owns the nodes; node 0 is the root. Built once per tool, O(n log n).
class InnerSphereTree {
 public:
  static constexpr int kBranching = 4;
  /// Halves differ by at most one leaf, so 2^30 spheres need at most 16 levels.
  static constexpr int kMaxLevels = 16;
  /// Stack size of a depth-first traversal: each level leaves at most three siblings.
  static constexpr int kMaxWaiting = kMaxLevels * (kBranching - 1) + 1;

  InnerSphereTree() = default;
  explicit InnerSphereTree(std::span<const Sphere> spheres);
  /// From stored nodes. Errors: they are not laid out like nodes() (breadth first, siblings
  /// contiguous), or a sphere is missing or not inside all its ancestors. O(n log n).
  static Result<InnerSphereTree> restore(std::vector<IstNode> nodes,
                                         std::span<const Sphere> spheres);

  std::span<const IstNode> nodes() const { return nodes_; }

  /// The sphere that contains p (|p - c| <= r, in double on the stored numbers), or -1. At most one
  /// can, because the packing is disjoint (thesis Alg. 3.2, corrected). No allocation.
  int find_leaf(const Vec3d& p) const;

 private:
  std::vector<IstNode> nodes_;
};

// Neighborhood graph of the spheres of a packing (thesis section 3.3.1).

/// Decides by the gap between their surfaces whether two spheres are neighbors.
enum class GapRule {
  absolute,  ///< gap < 2 * smallest radius of the packing: the thesis' rule
  relative,  ///< gap <= 0.5 * smaller of the two radii: scale-free, stable under prefixes
};
constexpr auto names_of(GapRule) { return std::array{"absolute", "relative"}; }

/// Undirected, connected graph over the spheres, in compressed rows: the neighbors of sphere i are
/// neighbors()[row_starts()[i] ... row_starts()[i+1]), ascending.
class LeafGraph {
 public:
  /// Disjoint spheres have less than a fifth of it, by either rule.
  static constexpr std::size_t kMaxMeanNeighbors = 1000;

  LeafGraph() = default;
  /// Edges by the gap rule, then the shortest bridges (smallest gap, ties by lower indices) until
  /// one component remains. O(n log n) for packings. Without rows if there are more than
  /// kMaxMeanNeighbors neighbors of a sphere on average.
  LeafGraph(std::span<const Sphere> spheres, GapRule rule);
  /// From stored edges (a, b) with a < b. The ids must be valid; they are not checked here.
  LeafGraph(std::size_t num_spheres, std::span<const std::pair<int, int>> edges, int num_bridges,
            int num_components_before_bridging);

  /// Neighbors of sphere i: neighbors()[row_starts()[i] ... row_starts()[i + 1]).
  std::span<const std::int32_t> row_starts() const { return row_starts_; }
  std::span<const std::int32_t> neighbors() const { return neighbors_; }

  int num_edges() const { return static_cast<int>(neighbors_.size() / 2); }
  /// Edges that were added to join components, and the number of components without them.
  int num_bridges() const { return num_bridges_; }
  int num_components_before_bridging() const { return num_components_before_bridging_; }
  /// Each edge once, (a, b) with a < b, sorted.
  std::vector<std::pair<int, int>> edges() const;

 private:
  void set_edges(std::size_t num_spheres, std::span<const std::pair<int, int>> edges);

  std::vector<std::int32_t> row_starts_, neighbors_;
  int num_bridges_ = 0;
  int num_components_before_bridging_ = 0;
};

// A rigid CAD tool ready for contact: its mesh, its spheres, and everything that is computed once
// from them.

/// Options of a tool, besides its mesh and spheres.
struct ToolOptions {
  GapRule gap_rule = GapRule::relative;  ///< neighbors in the leaf graph
  std::string source = {};               ///< source of the mesh, for display
  int num_threads = 0;                   ///< 0: one per core. Same bits for any number.
};

/// Immutable. Everything is in the tool frame T, which is the frame of the mesh. SI units.
class Tool {
 public:
  /// Packs a mesh that passed check_solid with spheres, and builds the tool of both. Errors: those
  /// of pack_spheres and build.
  static Result<Tool> pack(TriangleMesh mesh, const PackOptions& packing = {},
                           ToolOptions options = {});
  /// Builds the tool of a mesh and your own packing: tree, graph, mass properties and represented
  /// volumes. Errors: no spheres, or more than 2^30; spheres that overlap far more than those of a
  /// packing (LeafGraph::kMaxMeanNeighbors); the mesh encloses no volume.
  static Result<Tool> build(TriangleMesh mesh, SpherePacking packing, ToolOptions options = {});
  /// Parts that take long to compute and are stored in tool files.
  struct StoredParts {
    LeafGraph graph;
    GapRule gap_rule = GapRule::relative;  ///< rule of the graph
    RepresentedParts represented;
    std::vector<IstNode> tree_nodes;
    std::shared_ptr<const SolidField> solid_field = nullptr;  ///< null: none
  };
  /// Adds a distance field: `palpate pack` stores it, for contact with other bodies. About a
  /// second.
  Tool with_solid_field(int num_threads = 0) &&;
  /// From stored parts (used by load_tool).
  static Result<Tool> restore(TriangleMesh mesh, SpherePacking packing, StoredParts parts,
                              std::string source);
  /// A coarser tool of the first `num_spheres` spheres, identical to a packing of that number.
  /// Errors: fewer than one, or more than there are; those of build.
  Result<Tool> prefix(int num_spheres, int num_threads = 0) const;

  /// The same, but torques keep the reference point of this tool: replaces it in a run that cannot
  /// compute all spheres in time.
  Result<Tool> thinned(int num_spheres, int num_threads = 1) const;

  const TriangleMesh& mesh() const { return mesh_; }
  std::span<const Sphere> spheres() const { return packing_.spheres; }
  const SpherePacking& packing() const { return packing_; }
  const InnerSphereTree& tree() const { return tree_; }
  const LeafGraph& graph() const { return parts_.graph; }
  GapRule gap_rule() const { return parts_.gap_rule; }
  /// The part of the solid that each sphere represents, m3. The sum is the volume of the mesh.
  std::span<const float> represented_volumes() const { return parts_.represented.volumes; }
  /// Balls with the centroids and second moments of these parts (RepresentedParts).
  std::span<const Sphere> represented_balls() const { return parts_.represented.balls; }
  /// The distance field of its surface; null if the tool has none: then contact with other bodies
  /// computes one (ToolIndex).
  const std::shared_ptr<const SolidField>& solid_field() const { return parts_.solid_field; }
  /// Mass properties of the spheres at density 1 (eqs. 3.4-3.6). Their center of mass is the
  /// reference point of all torques.
  const MassProperties& sphere_mass() const { return sphere_mass_; }
  /// Mass properties of the solid itself at density 1, exact.
  const MassProperties& mesh_mass() const { return mesh_mass_; }
  /// Source of the mesh, for display.
  const std::string& source() const { return source_; }

 private:
  TriangleMesh mesh_;
  SpherePacking packing_;
  InnerSphereTree tree_;
  StoredParts parts_;
  MassProperties sphere_mass_, mesh_mass_;
  std::string source_;
};

}}  // namespace palpate::v0
