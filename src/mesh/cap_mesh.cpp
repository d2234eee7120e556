#include "palpate/mesh/mesh.h"

#include <algorithm>
#include <cmath>

#include "src/core/internal/assert.h"
#include "src/mesh/rings.h"

namespace palpate { inline namespace v0 {
namespace {

/// e2 x e3 = e1, all of length one (thesis section 4.3.1; there e2 is not normalized).
struct Basis {
  Vec3d e1, e2, e3;
};

Basis basis_along(const Vec3d& normal) {
  const Vec3d e1 = normalized(normal);
  const double x = std::abs(e1.x), y = std::abs(e1.y), z = std::abs(e1.z);
  const Vec3d cross_axis = x <= y && x <= z ? Vec3d{1, 0, 0}
                           : y <= z         ? Vec3d{0, 1, 0}
                                            : Vec3d{0, 0, 1};
  const Vec3d e2 = normalized(cross(e1, cross_axis));
  return {e1, e2, cross(e1, e2)};
}

/// Rings from the pole to the angle `opening`: as many as make triangles about as high as they are
/// wide where the cap is widest.
int num_rings(double opening, int segments) {
  const double widest = opening < kPi / 2 ? std::sin(opening) : 1;
  const double step = 2 * kPi / segments * widest;
  constexpr double kRounding = 1e-9;  // half a sphere has a quarter of the segments, not one more
  return std::max(1, static_cast<int>(std::ceil(opening / step - kRounding)));
}

void add_cap(TriangleMesh& mesh, const Sphere& sphere, const Plane<double>& plane, int segments) {
  PALPATE_ASSERT(segments >= 3 && sphere.radius > 0);
  const double length = norm(plane.normal);
  const bool has_plane = length > 0;
  const Basis basis = basis_along(has_plane ? plane.normal : Vec3d{0, 0, 1});
  const Vec3d center = to_double(sphere.center);
  const double radius = sphere.radius;
  const double distance = has_plane ? (dot(plane.normal, center) - plane.offset) / length : -radius;
  PALPATE_ASSERT(std::isfinite(distance));
  if (radius - distance <= kFlattestCap * radius) return;
  const bool is_whole = radius + distance <= kFlattestCap * radius;

  // Angles are measured at the center of the sphere, from the pole that lies deepest.
  const double circle_radius = std::sqrt(std::max(0.0, (radius - distance) * (radius + distance)));
  const double opening = is_whole ? kPi : std::atan2(circle_radius, distance);
  const int rings = num_rings(opening, segments);
  const auto ring = [&](int k) {
    const double angle = opening * k / rings;
    return add_ring(mesh, center - basis.e1 * (radius * std::cos(angle)), basis.e2, basis.e3,
                    radius * std::sin(angle), segments);
  };
  Ring upper = ring(1);
  close_below(mesh, upper, center - basis.e1 * radius);
  const int last = is_whole ? rings - 1 : rings;
  for (int k = 2; k <= last; ++k) {
    const Ring lower = upper;
    upper = ring(k);
    connect(mesh, lower, upper);
  }
  // The other pole, or the center of the disc (eq. 4.20).
  close_above(mesh, upper, center - basis.e1 * (is_whole ? -radius : distance));
}

}  // namespace

TriangleMesh cap_mesh(const Sphere& sphere, const Plane<double>& plane, int segments) {
  TriangleMesh mesh;
  add_cap(mesh, sphere, plane, segments);
  return mesh;
}

TriangleMesh inside_mesh(std::span<const Sphere> spheres, std::span<const Plane<double>> planes,
                         int segments) {
  PALPATE_ASSERT(spheres.size() == planes.size());
  TriangleMesh mesh;
  for (std::size_t s = 0; s < spheres.size(); ++s) add_cap(mesh, spheres[s], planes[s], segments);
  return mesh;
}

}}  // namespace palpate::v0
