// Where cameras are that look at one scene, found out from what they see.
#pragma once

#include <span>
#include <string>
#include <vector>

#include "palpate/cloud/point_cloud.h"
#include "palpate/core/result.h"
#include "palpate/math/pose.h"

namespace palpate {

/// Two views of one scene: how far their surfaces are apart, where both see the same.
struct ViewPair {
  int a = 0, b = 0;            ///< numbers of the views
  std::size_t num_points = 0;  ///< of one that have been compared with the other, both ways
  /// m, of points from the planes of the other view: the standard deviation by the median.
  double before = 0;
  double after = 0;   ///< m, likewise, with the refined poses
  double turned = 0;  ///< rad, by how much the pose of one in the other has changed
  double moved = 0;   ///< m, likewise, at the middle of what both see
};

struct AlignedViews {
  std::vector<Pose> X_WC;  ///< the first one's is as it was
  std::vector<ViewPair> pairs;
  /// m: about how far the worst camera may be off in the direction in which the scene holds it
  /// least, by the noise of what is seen; turns count at the size of the scene.
  double uncertainty = 0;
};

struct AlignOptions {
  /// m: surfaces of two views that are farther apart than this are not the same; shrinks to
  /// `least_reach` as the poses get better.
  double reach = 0.06, least_reach = 0.01;
  int max_points = 20000;  ///< of each view
  int max_rounds = 100;
};

/// Refines poses that are about right (5 cm, 5 degrees): all views at once, so that the surfaces of
/// those that see the same lie on each other (point to plane, Chen & Medioni 1992, with projective
/// association both ways, Blais & Levine 1995; robust by Tukey's weights). Organised pinhole clouds
/// with normals, in host memory. `names` are for messages. O(points x pairs x rounds): about a
/// second for four views. Errors: fewer than two views; a view that shares nothing with the others;
/// a scene with too little shape (a wall, a ball); surfaces that stay more than 5 mm apart; no
/// convergence.
Result<AlignedViews> align_views(std::span<const PointCloudView> views, std::span<const Pose> X_WC,
                                 std::span<const std::string> names,
                                 const AlignOptions& options = {});

}  // namespace palpate
