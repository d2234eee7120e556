// The surface around the pixel that is nearest to a sphere: a plane through the depths of the
// pixels around it, which has less noise than the pixel itself.
#pragma once

#include <algorithm>

#include "palpate/math/geometry.h"
#include "src/contact/clearance/clearance_search.h"

namespace palpate { inline namespace v0 {

/// A plane is taken if it changes a distance by no more than this and what the width of a pixel
/// explains, m at 1 m of depth and nearer; more where noise grows, with the square of the depth.
inline constexpr double kPlaneChange = 1e-3;

/// Half the diagonal of a pixel at a depth, m: a pixel's middle is farther than its surface by
/// less.
inline double pixel_reach(const ClearanceImage& image, double depth) {
  return 0.71 * depth * static_cast<double>(std::max(image.per_fx, image.per_fy));
}

/// Largest change that a plane makes at any depth up to this, m.
inline double plane_change(const ClearanceImage& image, double depth) {
  return kPlaneChange * std::max(1.0, depth * depth) + pixel_reach(image, depth);
}

/// Signed distance of a point, and its derivative by the point.
struct PointDistance {
  double phi = 0;
  Vec3d gradient = {};
};

/// Returns the distance of a sphere's center that a search has found, in the camera frame.
/// Distances to surfaces are those to a plane through up to 9 x 9 pixels of one surface, if the
/// foot of the point lies among them, else those to the pixel.
PointDistance refined_distance(const ClearanceImage& image, const ClearanceHit& hit,
                               const Vec3d& p_C);

}}  // namespace palpate::v0
