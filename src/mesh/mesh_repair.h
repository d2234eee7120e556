// Repairs of a mesh that do not change its solid.
#pragma once

#include <cstddef>

#include "palpate/mesh/mesh.h"
#include "src/mesh/mesh_topology.h"

namespace palpate { inline namespace v0 {

/// Drops vertices that no face uses; the others keep their order.
void drop_unused_vertices(TriangleMesh& mesh);

/// Vertices closer than `tolerance` to an earlier kept vertex become that vertex, and faces that
/// lose a corner by it are dropped: their other two edges cancel, so a closed mesh stays closed.
/// Returns the number of dropped faces. O(n).
std::size_t weld_vertices(TriangleMesh& mesh, double tolerance);

/// True if the height of the face over its longest edge is at most `tolerance`.
bool is_needle(const TriangleMesh& mesh, const Triangle& triangle, double tolerance);

/// Removes the needles of a closed mesh: a needle a-b-c whose corner c lies on its longest edge ab
/// is dropped, and the face beyond ab is split at c instead. Returns the number of removed needles;
/// `is_needle` holds for those that could not be removed.
std::size_t remove_needles(TriangleMesh& mesh, double tolerance);

}}  // namespace palpate::v0
