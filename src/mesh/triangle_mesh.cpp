#include "palpate/mesh/mesh.h"

#include <algorithm>

namespace palpate { inline namespace v0 {

Bounds bounds(const TriangleMesh& mesh) {
  if (mesh.vertices.empty()) return {};
  Bounds box{mesh.vertices.front(), mesh.vertices.front()};
  for (const Vec3d& p : mesh.vertices) {
    for (int axis = 0; axis < 3; ++axis) {
      box.low[axis] = std::min(box.low[axis], p[axis]);
      box.high[axis] = std::max(box.high[axis], p[axis]);
    }
  }
  return box;
}

}}  // namespace palpate::v0
