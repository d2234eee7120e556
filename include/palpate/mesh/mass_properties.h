// Volume, centre of mass and inertia of solids.
#pragma once

#include <span>

#include "palpate/math/sphere.h"
#include "palpate/mesh/triangle_mesh.h"

namespace palpate {

/// At density 1 kg/m3, so that mass equals volume.
struct MassProperties {
  double volume = 0;     ///< m3
  Vec3d centre_of_mass;  ///< m
  Mat3d inertia;         ///< kg m2 about the centre of mass, axes of the given frame
};

/// Exact for a closed mesh (divergence theorem). O(triangles).
MassProperties mass_properties(const TriangleMesh& mesh);

/// Of disjoint balls of density 1 (thesis eqs. 3.4-3.6). O(spheres).
MassProperties mass_properties(std::span<const Sphere> spheres);

}  // namespace palpate
