// A rigid CAD tool ready for contact: its mesh, the spheres that fill it, and all that is built
// from them once, before the hand moves.
#pragma once

#include <string>

#include "palpate/core/result.h"
#include "palpate/ist/inner_sphere_tree.h"
#include "palpate/ist/leaf_graph.h"
#include "palpate/mesh/mass_properties.h"
#include "palpate/mesh/triangle_mesh.h"
#include "palpate/packing/packer.h"

namespace palpate {

/// Immutable after construction. Everything is in the tool frame T, which is the frame of the mesh.
class Tool {
 public:
  /// Builds tree, graph and mass properties. Error: no spheres, or more than 2^30.
  static Result<Tool> build(TriangleMesh mesh, SpherePacking packing, GapRule rule,
                            std::string source);
  /// From stored parts, without rebuilding the graph (used by load_tool).
  static Result<Tool> restore(TriangleMesh mesh, SpherePacking packing, LeafGraph graph,
                              std::string source);

  const TriangleMesh& mesh() const { return mesh_; }
  std::span<const Sphere> spheres() const { return packing_.spheres; }
  const SpherePacking& packing() const { return packing_; }
  const InnerSphereTree& tree() const { return tree_; }
  const LeafGraph& graph() const { return graph_; }
  /// Of the spheres at density 1 (eqs. 3.4-3.6): its centre of mass is the reference point of all
  /// torques.
  const MassProperties& sphere_mass() const { return sphere_mass_; }
  /// Of the solid itself at density 1, exact.
  const MassProperties& mesh_mass() const { return mesh_mass_; }
  /// Where the mesh came from, for people.
  const std::string& source() const { return source_; }

 private:
  TriangleMesh mesh_;
  SpherePacking packing_;
  InnerSphereTree tree_;
  LeafGraph graph_;
  MassProperties sphere_mass_, mesh_mass_;
  std::string source_;
};

}  // namespace palpate
