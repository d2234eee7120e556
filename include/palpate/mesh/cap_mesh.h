// The part of a sphere behind a plane as triangles, for pictures (thesis section 4.3.1).
#pragma once

#include <cstddef>
#include <span>

#include "palpate/math/sphere.h"
#include "palpate/mesh/triangle_mesh.h"

namespace palpate {

/// A cap flatter than this share of the radius is left out, and a ball that misses no more is
/// whole: 1e-12 of the volume, and its corners could hardly be told apart.
inline constexpr double kFlattestCap = 1e-6;

/// The closed surface, outward, of the points of the ball with normal . x <= offset: a disc on the
/// plane, rings of triangles about as high as wide, and a pole (Alg. 4.1 corrected). The normal may
/// have any length; a zero one cuts nothing. The whole ball if all of it lies behind the plane,
/// empty if none does. All vertices but the disc's centre lie on the sphere, those of the disc on
/// the plane too, so that the volume is less than cap_volume, by 20 / segments^2 of it at most.
/// `segments`, at least 3, go round.
TriangleMesh cap_mesh(const Sphere& sphere, const Plane<double>& plane, int segments);

/// cap_mesh of every sphere and its plane, one after the other in one mesh: closed shells that
/// share no vertices. There are as many planes as spheres, and fewer than 2^32 vertices in all.
TriangleMesh inside_mesh(std::span<const Sphere> spheres, std::span<const Plane<double>> planes,
                         int segments);

/// No cap has more triangles.
constexpr std::size_t max_cap_triangles(int segments) {
  const auto n = static_cast<std::size_t>(segments);
  return n * (n + 1);
}

}  // namespace palpate
