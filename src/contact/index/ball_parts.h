// A ball in parts: the quadrature elements of large spheres.
#pragma once

#include <vector>

#include "palpate/math/geometry.h"

namespace palpate::inline v0 {

struct BallPart {
  Vec3d centre;
  double radius = 0, share = 0;  ///< share: of the whole ball's volume
};

/// Thirty of the unit ball, at the edge midpoints of an icosahedron: close to the least squares fit
/// to the cap volumes of the ball. The share of it behind any plane is off by 0.8 % at most, 0.4 %
/// rms. For large surfaces: they are too many near its surface, and reach out of it.
std::vector<BallPart> thirty_parts();

/// Of the unit ball, which they fill evenly: the cells of a face-centred cubic lattice, cut off at
/// its surface, each a ball of its volume at its centroid. Whole ones have this radius.
std::vector<BallPart> even_parts(double radius);

}  // namespace palpate::inline v0
