// Closed meshes for the bodies of scenes.
#pragma once

#include <span>
#include <vector>

#include "palpate/math/geometry.h"
#include "palpate/mesh/mesh.h"

namespace palpate { inline namespace v0 { namespace scenes {

/// From corner to corner.
TriangleMesh block(const Vec3d& low, const Vec3d& high);
/// Adds a part to a body.
void append(TriangleMesh& body, const TriangleMesh& part);

struct Ball {
  Vec3d center;
  double radius;
};
/// A finger, an arm, a neck: the hulls of each two neighboring balls, of which neither may contain
/// the other.
using BallChain = std::vector<Ball>;
/// Axes parallel to the frame's.
struct Ellipsoid {
  Vec3d center, radii;
};

/// Parts of clay pressed together: creases between parts closer than about `blend` (m) are filled.
/// The surface is taken from a grid of cubes with side `cell` (m), which must be well below the
/// smallest radius.
TriangleMesh blended(std::span<const BallChain> chains, std::span<const Ellipsoid> ellipsoids,
                     double blend, double cell);

}}}  // namespace palpate::v0::scenes
