// Small tools of generated shapes, filled as `palpate pack` fills them.
#pragma once

#include <utility>

#include "palpate/math/geometry.h"
#include "palpate/mesh/mesh.h"
#include "palpate/tool/tool.h"

namespace palpate::test {

inline Tool packed_tool(TriangleMesh mesh, int num_spheres = 300) {
  return Tool::pack(std::move(mesh), {.max_spheres = num_spheres, .num_threads = 1},
                    {.source = "packed", .num_threads = 1})
      .value();
}

/// Turned about the origin, then moved.
inline TriangleMesh moved(TriangleMesh mesh, const Pose& X) {
  for (Vec3d& p : mesh.vertices) p = X * p;
  return mesh;
}

}  // namespace palpate::test
