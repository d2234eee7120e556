// Parts of round meshes: circles of vertices and the faces between them.
#pragma once

#include <cmath>
#include <cstdint>

#include "palpate/math/geometry.h"
#include "palpate/mesh/mesh.h"

namespace palpate { inline namespace v0 {

inline std::uint32_t add_vertex(TriangleMesh& mesh, const Vec3d& p) {
  mesh.vertices.push_back(p);
  return static_cast<std::uint32_t>(mesh.vertices.size() - 1);
}

/// A circle of vertices is named by its first index.
struct Ring {
  std::uint32_t first = 0;
  std::uint32_t count = 0;

  std::uint32_t operator[](std::uint32_t i) const { return first + i % count; }
};

/// Circle around `center` from e1 towards e2 (both of length one).
inline Ring add_ring(TriangleMesh& mesh, const Vec3d& center, const Vec3d& e1, const Vec3d& e2,
                     double radius, int segments) {
  const Ring ring{static_cast<std::uint32_t>(mesh.vertices.size()),
                  static_cast<std::uint32_t>(segments)};
  for (int i = 0; i < segments; ++i) {
    const double angle = 2 * kPi * i / segments;
    add_vertex(mesh, center + (e1 * std::cos(angle) + e2 * std::sin(angle)) * radius);
  }
  return ring;
}

/// The tube wall from `a` to `b`, which lies on the side of e1 x e2.
inline void connect(TriangleMesh& mesh, const Ring& a, const Ring& b) {
  for (std::uint32_t i = 0; i < a.count; ++i) {
    mesh.triangles.push_back({a[i], a[i + 1], b[i + 1]});
    mesh.triangles.push_back({a[i], b[i + 1], b[i]});
  }
}

/// Faces from the ring to an apex on the side of e1 x e2, or in its plane.
inline void close_above(TriangleMesh& mesh, const Ring& ring, const Vec3d& apex) {
  const std::uint32_t top = add_vertex(mesh, apex);
  for (std::uint32_t i = 0; i < ring.count; ++i) {
    mesh.triangles.push_back({ring[i], ring[i + 1], top});
  }
}

/// The same on the other side.
inline void close_below(TriangleMesh& mesh, const Ring& ring, const Vec3d& apex) {
  const std::uint32_t bottom = add_vertex(mesh, apex);
  for (std::uint32_t i = 0; i < ring.count; ++i) {
    mesh.triangles.push_back({ring[i + 1], ring[i], bottom});
  }
}

}}  // namespace palpate::v0
