// A ball in parts: the quadrature elements of large spheres.
#pragma once

#include <vector>

#include "palpate/math/geometry.h"
#include "src/contact/index/sphere_clusters.h"

namespace palpate { inline namespace v0 {

struct BallPart {
  Vec3d center;
  double radius = 0, share = 0;  ///< share: of the whole ball's volume
};

/// Places thirty parts of the unit ball at the edge midpoints of an icosahedron: close to the least
/// squares fit to the cap volumes of the ball. The share of it behind any plane is off by 0.8 % at
/// most, 0.4 % rms, which ball_cut.h corrects.
std::vector<BallPart> thirty_parts();

/// The thirty parts as the first elements of a cluster: x, y and z, and 1. Zeros for the others.
struct BallPlaces {
  alignas(64) float rows[4][SphereClusters::kSize] = {};
};
const BallPlaces& ball_places();

/// Splits the unit ball evenly: into the cells of a face-centered cubic lattice, cut off at its
/// surface, each a ball of its volume at its centroid. Whole ones have this radius.
std::vector<BallPart> even_parts(double radius);

}}  // namespace palpate::v0
