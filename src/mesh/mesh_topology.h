// Topology of a mesh: its edges with the faces that meet there, and its connected shells.
#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include "palpate/mesh/mesh.h"

namespace palpate { inline namespace v0 {

using Triangle = std::array<std::uint32_t, 3>;

/// One side of an edge: face `face` runs from vertex `from` to vertex `to`.
struct HalfEdge {
  std::uint32_t from, to;
  std::uint32_t face;
};

/// All half-edges, sorted such that those of one edge are neighbors. O(n log n).
std::vector<HalfEdge> sorted_half_edges(const std::vector<Triangle>& triangles);

/// True if both run between the same two vertices, whatever the direction.
bool same_edge(const HalfEdge& a, const HalfEdge& b);

/// Numbers of faulty edges of a mesh. All zero: the surface is closed and oriented.
struct EdgeFaults {
  std::size_t open = 0;          ///< edges of one face
  std::size_t non_manifold = 0;  ///< edges of more than two faces
  std::size_t inconsistent = 0;  ///< edges whose two faces disagree on which side is out
  HalfEdge first{};              ///< the first faulty edge, if any

  bool none() const { return open + non_manifold + inconsistent == 0; }
};

EdgeFaults find_edge_faults(const std::vector<Triangle>& triangles);

/// The shell of every face: 0, 1, ... in the order of their first faces. Faces with a common edge
/// belong to one shell.
std::vector<std::uint32_t> shell_of_faces(const std::vector<Triangle>& triangles);

}}  // namespace palpate::v0
