// Interpolation between two frames: each pixel's point on the way from one cloud to the other
// (thesis section 3.6, eq. 3.18).
#pragma once

#include <algorithm>

#include "palpate/cloud/point_cloud.h"
#include "palpate/core/core.h"

namespace palpate { inline namespace v0 {

/// Share of the way from one frame to the next, `period` later, at `time`: (t_C - t_L) / t_D of eq.
/// 3.18, 1 if the next frame is late.
inline double frame_progress(double time, double last_frame, double period) {
  return std::clamp((time - last_frame) / period, 0.0, 1.0);
}

/// P = (1 - t) P_old + t P_new for each pixel (u, v) of two organized clouds of one size; the
/// normal likewise, of unit length again. With t above 1 the motion goes on beyond the new frame.
/// Points of two surfaces have no point between them: where one is invalid or their depths differ
/// by more than `max_jump` of the new one's, the new point (or its absence) stands. `out` has the
/// same size and camera, and is neither of the two. No allocation; the same bits for any number of
/// threads.
void blend_clouds(const PointCloudView& old_cloud, const PointCloudView& new_cloud, double t,
                  double max_jump, ThreadPool& pool, PointCloud& out);

}}  // namespace palpate::v0
