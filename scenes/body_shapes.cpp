#include "scenes/body_shapes.h"

#include "palpate/mesh/mesh.h"

namespace palpate { inline namespace v0 { namespace scenes {

TriangleMesh block(const Vec3d& low, const Vec3d& high) {
  TriangleMesh mesh = make_box(high - low);
  for (Vec3d& p : mesh.vertices) p += (low + high) / 2.0;
  return mesh;
}

void append(TriangleMesh& body, const TriangleMesh& part) {
  const auto first = static_cast<std::uint32_t>(body.vertices.size());
  body.vertices.insert(body.vertices.end(), part.vertices.begin(), part.vertices.end());
  for (const auto& [a, b, c] : part.triangles) {
    body.triangles.push_back({first + a, first + b, first + c});
  }
}

}}}  // namespace palpate::v0::scenes
