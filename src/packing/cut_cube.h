// How a cube meets planes and triangles.
#pragma once

#include "palpate/math/vec3.h"
#include "src/packing/triangle_bvh.h"

namespace palpate {

struct Cube {
  Vec3d centre;
  double half = 0;  ///< half of the side
};

/// Fraction of the cube where normal . (x - centre) <= offset; exact but for planes nearly parallel
/// to an axis, which are tilted by 1e-4. The normal need not be unit; 0: all or nothing.
double fraction_behind(const Cube& cube, const Vec3d& normal, double offset);

/// Separating axes (Akenine-Moeller 2001). Touching counts, within rounding.
bool overlaps(const Cube& cube, const Triangle& triangle);

/// Whether the segment from p to q crosses the triangle.
bool crosses(const Vec3d& p, const Vec3d& q, const Triangle& triangle);

}  // namespace palpate
