// Closed meshes for the bodies of scenes.
#pragma once

#include <span>

#include "palpate/math/vec3.h"
#include "palpate/mesh/triangle_mesh.h"

namespace palpate::scenes {

/// From corner to corner.
TriangleMesh block(const Vec3d& low, const Vec3d& high);
/// Adds a part to a body.
void append(TriangleMesh& body, const TriangleMesh& part);

/// Hull of two balls: a phalanx, an arm, a neck. One ball may not contain the other.
struct RoundCone {
  Vec3d a;
  double radius_a;
  Vec3d b;
  double radius_b;
};
/// Axes parallel to the frame's.
struct Ellipsoid {
  Vec3d centre, radii;
};

/// Parts of clay pressed together: creases closer than about `blend` (m) are filled. The surface is
/// taken from a grid of cubes with side `cell` (m), which must be well below the smallest radius.
TriangleMesh blended(std::span<const RoundCone> cones, std::span<const Ellipsoid> ellipsoids,
                     double blend, double cell);

}  // namespace palpate::scenes
