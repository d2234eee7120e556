// What a depth camera shows at a moment, and where in the world it stands.
#pragma once

#include <span>

#include "palpate/field/surface_timeline.h"
#include "palpate/math/pose.h"

namespace palpate {

/// One of the cameras that look at a scene; not owning, as SurfaceView. Each has its own moments:
/// cameras need neither one rate nor one size.
struct CameraView {
  SurfaceBlend surface;  ///< with more than one camera with SurfaceView::seen_free
  Pose X_WC;             ///< of the camera in the world
};

/// So many can be measured against at once.
inline constexpr int kMostCameras = 16;

/// The points of the newest surfaces of all cameras, in W, in one cloud: what methods of points
/// measure several cameras by, whatever lies in front of whom. Clouds in host memory; O(points).
PointCloud joined_clouds(std::span<const CameraView> cameras);

}  // namespace palpate
