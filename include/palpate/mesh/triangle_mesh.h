// Triangle meshes in metres.
#pragma once

#include <array>
#include <cstdint>
#include <vector>

#include "palpate/math/vec3.h"

namespace palpate {

/// Indexed triangles; counter-clockwise seen from outside.
struct TriangleMesh {
  std::vector<Vec3d> vertices;                          ///< metres
  std::vector<std::array<std::uint32_t, 3>> triangles;  ///< vertex indices
};

/// Axis-aligned box.
struct Bounds {
  Vec3d low, high;
};

/// Smallest box around all vertices; zero box for an empty mesh.
Bounds bounds(const TriangleMesh& mesh);

}  // namespace palpate
