// A rigid CAD tool ready for contact: its mesh, the spheres that fill it, and all that is built
// from them once, before the hand moves.
#pragma once

#include <memory>
#include <string>
#include <vector>

#include "palpate/core/result.h"
#include "palpate/ist/inner_sphere_tree.h"
#include "palpate/ist/leaf_graph.h"
#include "palpate/mesh/mass_properties.h"
#include "palpate/mesh/triangle_mesh.h"
#include "palpate/packing/packer.h"
#include "palpate/packing/represented_volumes.h"
#include "palpate/packing/solid_field.h"

namespace palpate {

/// Immutable after construction. Everything is in the tool frame T, which is the frame of the mesh.
class Tool {
 public:
  /// Builds tree, graph, mass properties and represented volumes; same bits for any `num_threads`
  /// (0: one per core). Error: no spheres, or more than 2^30; the mesh encloses no volume.
  static Result<Tool> build(TriangleMesh mesh, SpherePacking packing, GapRule rule,
                            std::string source, int num_threads = 0);
  /// What takes long to compute and is therefore stored in tool files.
  struct StoredParts {
    LeafGraph graph;
    GapRule gap_rule = GapRule::relative;  ///< of the graph
    std::vector<float> represented_volumes;
    std::vector<IstNode> tree_nodes;
    std::shared_ptr<const SolidField> solid_field = nullptr;  ///< null: it has none
  };
  /// The same with a distance field: what `palpate pack` stores for bodies that meet this one.
  /// About a second.
  Tool with_solid_field(int num_threads = 0) &&;
  /// From stored parts (used by load_tool).
  static Result<Tool> restore(TriangleMesh mesh, SpherePacking packing, StoredParts parts,
                              std::string source);
  /// A coarser tool of the first `num_spheres` spheres: what packing only so many would have given.
  /// Error: fewer than one, or more than there are.
  Result<Tool> prefix(int num_spheres, int num_threads = 0) const;

  /// The same, but torques are about the same point as this tool's: a stand-in for it in a run that
  /// has no time for all spheres.
  Result<Tool> thinned(int num_spheres, int num_threads = 1) const;

  const TriangleMesh& mesh() const { return mesh_; }
  std::span<const Sphere> spheres() const { return packing_.spheres; }
  const SpherePacking& packing() const { return packing_; }
  const InnerSphereTree& tree() const { return tree_; }
  const LeafGraph& graph() const { return parts_.graph; }
  GapRule gap_rule() const { return parts_.gap_rule; }
  /// The part of the solid that each sphere stands for, m3: together the volume of the mesh.
  std::span<const float> represented_volumes() const { return parts_.represented_volumes; }
  /// How far its surface is; null if the tool was made without: then bodies that meet it make one
  /// for themselves (ToolIndex).
  const std::shared_ptr<const SolidField>& solid_field() const { return parts_.solid_field; }
  /// Of the spheres at density 1 (eqs. 3.4-3.6): its centre of mass is the reference point of all
  /// torques.
  const MassProperties& sphere_mass() const { return sphere_mass_; }
  /// Of the solid itself at density 1, exact.
  const MassProperties& mesh_mass() const { return mesh_mass_; }
  /// Where the mesh came from, for humans.
  const std::string& source() const { return source_; }

 private:
  TriangleMesh mesh_;
  SpherePacking packing_;
  InnerSphereTree tree_;
  StoredParts parts_;
  MassProperties sphere_mass_, mesh_mass_;
  std::string source_;
};

}  // namespace palpate
