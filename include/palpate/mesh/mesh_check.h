// Is this mesh a solid? Everything downstream relies on the answer.
#pragma once

#include <string>
#include <vector>

#include "palpate/core/result.h"
#include "palpate/mesh/triangle_mesh.h"

namespace palpate {

struct MeshCheckOptions {
  /// Vertices closer than this fraction of the bounding box diagonal become one.
  double weld_fraction = 1e-7;
  /// A tool with a longer box side (metres) is refused: its unit is probably wrong.
  double max_extent = 2.0;
  /// A tool whose longest box side (metres) is shorter is refused likewise.
  double min_extent = 1e-4;
};

/// A mesh that bounds a solid, and what was repaired to make it so (each a sentence for the user).
struct SolidMesh {
  TriangleMesh mesh;
  std::vector<std::string> warnings;
};

/// Welds vertices, drops unused ones and zero-area faces, then checks: finite coordinates, indices
/// in range, every edge in exactly two faces with opposite directions, positive volume (an inside
/// out mesh is turned, with a warning), no self-intersection, no overlapping or nested shells with
/// the wrong orientation, a sane extent. The first fault found is returned as an Error that says
/// what, where and what to do. O(n log n).
Result<SolidMesh> check_solid(const TriangleMesh& raw, const MeshCheckOptions& options = {});

}  // namespace palpate
