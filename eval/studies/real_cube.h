// A cube that a depth camera recorded from a moving hand, and its true pose: the recording
// "sequences/visp_rbt", whose cube of 85 mm is known from its CAD.
//
// The camera was tracked by a board behind the cube, a meter away; located by that alone, the cube
// would wander by a centimeter. So the exact cube is fitted to each frame by its own faces: the
// depth is compared only with three planes at right angles, 85 mm apart. The residuals are the
// sensor's.
#pragma once

#include <optional>
#include <vector>

#include "eval/context.h"

namespace palpate::eval {

/// Intersection of a camera ray with a cube.
struct CubeHit {
  double z = 0;       ///< m, depth
  int face = 0;       ///< -x, +x, -y, +y, -z, +z of the cube's frame B
  double border = 0;  ///< m, distance of the hit point from the nearest edge
  double slant = 0;   ///< cosine between ray and normal
};
/// Returns nullopt if the ray misses. The camera must be outside.
std::optional<CubeHit> hit_cube(const Pose& X_CB, double half_size, const Vec3d& ray_C);

/// One frame with its cube.
struct CubeFrame {
  DepthFrame frame;    ///< with X_WC by the board's tracking; W is the board's frame
  Pose X_CB;           ///< fitted to the faces
  Pose tracked_shift;  ///< pose of the resting cube by the board's tracking, in B
};

struct RealCube {
  DepthStreamInfo stream;
  double half_size = 0;  ///< m
  Pose X_WB;             ///< its pose: the middle of those of all frames
  std::vector<CubeFrame> frames;
};

/// Reads every `stride`-th frame. nullopt: the data are absent. Errors: unreadable files, and a
/// frame to which the cube cannot be fitted.
Result<std::optional<RealCube>> real_cube(Context& context, std::size_t stride);

/// Returns the middle of the cube's poses in W by all frames: the medians along the axes, and the
/// rotation with the least sum of angles to all.
Pose middle_pose(const std::vector<Pose>& X_WB);

/// Estimates the camera pose of each frame from depth: each frame is aligned with an earlier key
/// frame as `palpate calibrate` aligns two cameras (align_views), starting from the tracked
/// relative pose. The first frame keeps its tracked pose; a frame that cannot be aligned continues
/// from the one before by the tracked motion. `num_by_tracking` counts these. Errors: an image that
/// SurfaceEstimator rejects.
Result<std::vector<Pose>> poses_by_depth(const RealCube& cube, int& num_by_tracking);

/// Fits the cube to the depth: Gauss-Newton on the distances of points from the face that their
/// pixel looks at, each face with the same weight; a free direction along an edge is set to where
/// most pixels agree. Returns false if hardly any of it is visible.
bool lay_on(const DepthStreamInfo& stream, const DepthFrame& frame, double half_size, Pose& X_CB);

/// Calls visit(pixel, hit) for the pixels that look at the cube, row by row.
template <class Visit>
void for_each_cube_pixel(const DepthStreamInfo& stream, const Pose& X_CB, double half_size,
                         int step, Visit visit) {
  double low_u = 1e9, high_u = 0, low_v = 1e9, high_v = 0;
  const Intrinsics& k = stream.intrinsics;
  for (int corner = 0; corner < 8; ++corner) {
    const Vec3d p = X_CB * (half_size * Vec3d{corner & 1 ? 1.0 : -1.0, corner & 2 ? 1.0 : -1.0,
                                              corner & 4 ? 1.0 : -1.0});
    const double u = k.fx * p.x / p.z + k.cx, v = k.fy * p.y / p.z + k.cy;
    low_u = std::min(low_u, u), high_u = std::max(high_u, u);
    low_v = std::min(low_v, v), high_v = std::max(high_v, v);
  }
  for (int v = std::max(0, static_cast<int>(low_v)); v <= std::min(stream.height - 1.0, high_v);
       v += step) {
    for (int u = std::max(0, static_cast<int>(low_u)); u <= std::min(stream.width - 1.0, high_u);
         u += step) {
      const auto hit = hit_cube(X_CB, half_size, {(u - k.cx) / k.fx, (v - k.cy) / k.fy, 1});
      if (!hit) continue;
      visit(static_cast<std::size_t>(v) * static_cast<std::size_t>(stream.width) +
                static_cast<std::size_t>(u),
            *hit);
    }
  }
}

}  // namespace palpate::eval
