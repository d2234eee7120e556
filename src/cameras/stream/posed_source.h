// The pose of a camera in the world at each of its frames.
#pragma once

#include <memory>
#include <optional>
#include <vector>

#include "palpate/cameras/cameras.h"
#include "palpate/cloud/depth_source.h"
#include "palpate/io/files.h"
#include "src/cameras/internal/link_in_tree.h"

namespace palpate { inline namespace v0 {

/// X_WC by time stamps: where something is, and where the camera is in it (hand-eye).
class CameraPoses {
 public:
  /// Opens the pose of a URI's camera, in the frame that its file of poses, URDF or tf provides.
  /// Errors: of the files; several of them. `is_received`: false if only a static pose is needed.
  static Result<CameraPoses> of(const CameraUri& uri);
  static Result<CameraPoses> of(const CameraUri& uri, bool is_received, RobotTrees& trees);

  /// Says where in that frame the camera of the images is.
  void see_from(const Pose& X_FC) { X_HC_ = X_HC_ * X_FC; }

  bool is_moving() const { return path_.size() > 1 || (link_ && link_->is_moving()); }
  /// The camera stays where others take it to be: at the origin of W, or where tf has it.
  bool is_left_alone() const {
    return path_.size() == 1 && path_.front().X_WT == Pose{} && !link_ && X_HC_ == Pose{};
  }
  /// True if times are on the clock of this computer. None: it stands still.
  std::optional<bool> is_live() const;
  /// Error: no pose for that time.
  Result<Pose> at(double time, double stamp = 0) const;
  /// Returns the pose at the capture of a frame; with tf, the frame has X_WH.
  Result<Pose> at(const DepthFrame& frame) const;

 private:
  std::vector<TimedPose> path_{{0, {}}};  // of H in W
  std::shared_ptr<const LinkInTree> link_;
  bool frames_have_poses_ = false;  // X_WH, by tf
  Pose X_HC_;
};

/// Returns what standing_pose(uri) returns; `trees` keeps URDFs for the next camera.
Result<std::optional<Pose>> standing_pose(const CameraUri& uri, RobotTrees& trees);

/// The same frames with their poses; those of projected clouds are seen from X_FC. Of a camera that
/// moves, frames for whose time there is no pose are left out, and a note says so. Error: a moving
/// camera is live and the source of its poses is not, or the reverse.
Result<std::unique_ptr<DepthSource>> make_posed(std::unique_ptr<DepthSource> source,
                                                CameraPoses poses,
                                                const std::optional<Pose>& X_FC = {});

}}  // namespace palpate::v0
