// Bound of the difference between clearances beyond the motion in between: the distance to what was
// seen changes by no more than the motion, but the plane around the nearest pixel, which takes the
// noise out of it, comes and goes.
#pragma once

#include <algorithm>

#include "palpate/contact/scene.h"
#include "src/contact/clearance/surface_plane.h"

namespace palpate { inline namespace v0 {

/// Returns the largest change (m) by which clearances of two poses may differ beyond the motion in
/// between, of spheres within `reach` (m) of a point p_W, whose nearest pixels lie no farther, in a
/// scene without bodies, whose distances have no such bound: they are sampled, and coarser farther
/// out.
inline double clearance_slack(const Scene& scene, const Vec3d& p_W, double reach) {
  double slack = 1e-5;  // of single precision
  for (const SurfaceView& surface : scene.surfaces) {
    const Intrinsics& k = surface.field.intrinsics;
    const double depth = std::max(0.0, (inverse(surface.X_WC) * p_W).z + reach);
    const double change = kPlaneChange * std::max(1.0, depth * depth);
    slack = std::max(slack, 2 * change + 0.71 * depth / std::min(k.fx, k.fy));
  }
  return slack;
}

}}  // namespace palpate::v0
