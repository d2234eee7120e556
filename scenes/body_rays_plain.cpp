// Rays through a mesh without a library: every pixel in the box around a triangle is asked if its
// ray meets it (Moeller & Trumbore 1997), in double. So the time grows with triangles and covered
// pixels, and no tree has to be built.
#include <array>
#include <cmath>

#include "scenes/body_rays.h"

namespace palpate { inline namespace v0 { namespace scenes {

struct BodyRays::Impl {
  const TriangleMesh& mesh;
};

BodyRays::BodyRays(const TriangleMesh& mesh) : impl_(new Impl{mesh}) {}
BodyRays::BodyRays(BodyRays&&) noexcept = default;
BodyRays::~BodyRays() = default;

void BodyRays::draw(const ImageRays& rays, const Pose& X_CB, std::span<float> image) const {
  const TriangleMesh& mesh = impl_->mesh;
  const Pose X_BC = inverse(X_CB);
  const Mat3d R_BC = rotation_matrix(X_BC.rotation);
  const Vec3d& origin = X_BC.translation;
  for (std::size_t t = 0; t < mesh.triangles.size(); ++t) {
    const auto& [i, j, k] = mesh.triangles[t];
    const std::array corners{mesh.vertices[i], mesh.vertices[j], mesh.vertices[k]};
    const Vec3d a = corners[1] - corners[0], b = corners[2] - corners[0], s = origin - corners[0];
    const Vec3d normal = cross(a, b), q = cross(s, a);
    const PixelBox pixels = rays.box_around(corners, X_CB);
    for (int v = pixels.v0; v < pixels.v1; ++v) {
      for (int u = pixels.u0; u < pixels.u1; ++u) {
        const Vec3d direction = R_BC * rays.ray(u, v);
        const double determinant = -dot(normal, direction);
        if (determinant == 0) continue;
        const double along_a = dot(cross(direction, b), s) / determinant;
        const double along_b = dot(direction, q) / determinant;
        if (!(along_a >= 0 && along_b >= 0 && along_a + along_b <= 1)) continue;
        const double depth = plane_depth(mesh, t, origin, direction);
        float& seen = image[rays.index(u, v)];
        if (depth > 0 && !(static_cast<double>(seen) <= depth)) seen = static_cast<float>(depth);
      }
    }
  }
}

}}}  // namespace palpate::v0::scenes
