// Poses are placed before the cameras some at a time, and looked at by the ball around their tool:
// most tools are far in front of all that a camera sees, which takes no search.
#pragma once

#include "src/contact/clearance/clearance_rules.h"

namespace palpate { inline namespace v0 {

/// Some poses of tools before the cameras of a scene.
struct PoseScreen {
  static constexpr int kMaxPoses = 64;  ///< poses

  // Arguments.
  const SeenByCamera* cameras = nullptr;
  int num_cameras = 0;
  const Pose* X_WT = nullptr;
  const ClearanceTool* tools[kMaxPoses] = {};  ///< of each pose
  int num = 0;
  float limit = 0;         ///< m: clearance from here on is not told apart
  bool is_margin = false;  ///< planes count, which may be nearer than pixels

  // Results of each pose.
  float change[kMaxPoses] = {};  ///< m: planes change distances by no more
  float least[kMaxPoses] = {};   ///< m: no pixel gives a sphere a lower clearance, up to the limit;
                                 ///< far below 0 of poses that are not finite
  float finite[kMaxPoses] = {};  ///< not finite if the pose is not
  /// Tool in each camera.
  struct Placed {
    float R_CT[3][3][kMaxPoses] = {}, p_CT[3][kMaxPoses] = {};
  } placed[kMaxCameras];

  /// m: pixels from here on do not matter to a clearance below this.
  float pixel_limit(int pose, double below) const {
    const float with_plane = static_cast<float>(below) + change[pose];
    return is_margin || with_plane < limit ? with_plane : limit;
  }
  /// True if a finite pose has no clearance below the limit, to what cameras have seen.
  bool is_far(int pose) const { return least[pose] >= (is_margin ? limit + change[pose] : limit); }
  /// Writes the place of a tool in all cameras.
  void put_cameras(int pose, ClearanceCamera* to) const {
    for (int k = 0; k < num_cameras; ++k) put_camera(pose, k, to[k]);
  }

 private:
  void put_camera(int pose, int camera, ClearanceCamera& to) const {
    const SeenByCamera& seen = cameras[camera];
    to.field = &seen.field;
    to.seen_free = seen.is_joined != 0 ? &seen.seen_free : nullptr;
    for (int row = 0; row < 3; ++row) {
      for (int column = 0; column < 3; ++column) {
        to.R_CT[row][column] = placed[camera].R_CT[row][column][pose];
      }
      to.p_CT[row] = placed[camera].p_CT[row][pose];
    }
  }
};

}}  // namespace palpate::v0
