// A cube that a depth camera recorded from a moving hand, and where it truly was: the recording
// "sequences/visp_rbt", whose cube of 85 mm is known from its CAD.
//
// The camera was tracked by a board behind the cube, a meter away; located by that alone, the cube
// would wander by a centimetre. So the exact cube is laid on each frame by its own faces: three
// planes at right angles, 85 mm apart, are all that the depth is tested for. What they leave over
// is the sensor's.
#pragma once

#include <optional>
#include <vector>

#include "eval/context.h"

namespace palpate::eval {

/// What a ray of the camera meets of a cube.
struct CubeHit {
  double z = 0;       ///< m, depth
  int face = 0;       ///< -x, +x, -y, +y, -z, +z of the cube's frame B
  double border = 0;  ///< m, of the point that is hit, from the next edge
  double slant = 0;   ///< cosine between ray and normal
};
/// nullopt: it passes by. The camera is outside.
std::optional<CubeHit> hit_cube(const Pose& X_CB, double half_size, const Vec3d& ray_C);

/// One frame with its cube.
struct CubeFrame {
  DepthFrame frame;    ///< its X_WC is what the board says, W being the board's frame
  Pose X_CB;           ///< laid on the faces
  Pose tracked_shift;  ///< where the board's tracking has the cube that stands still, in B
};

struct RealCube {
  DepthStreamInfo stream;
  double half_size = 0;  ///< m
  Pose X_WB;             ///< where it stands: the middle of what all frames say
  std::vector<CubeFrame> frames;
};

/// Every `stride`-th frame. nullopt: the data are not there. Errors: files that cannot be read, and
/// a frame on which the cube cannot be laid.
Result<std::optional<RealCube>> real_cube(Context& context, std::size_t stride);

/// Of the poses that the frames say the cube has in W: the medians along the axes, and the rotation
/// that is least far from all, in sum.
Pose middle_pose(const std::vector<Pose>& X_WB);

/// Where the camera was at each frame, by what it saw: each frame is aligned with a key frame
/// before it as `palpate calibrate` aligns two cameras (align_views), and the way between the two
/// that the tracking says is where it begins. The first frame is where the tracking has it, and a
/// frame that cannot be aligned is where the way from the one before leads. Errors: an image that
/// no SurfaceEstimator takes.
Result<std::vector<Pose>> poses_by_depth(const RealCube& cube, int& num_by_tracking);

/// Moves the cube until its faces fit the depth: Gauss-Newton on the distances of points from the
/// face that their pixel looks at, each face counting the same; along an edge that this leaves
/// free, to where most pixels agree. False: hardly anything is seen of it.
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
