// Where a camera is in the world at each of its frames.
#pragma once

#include <functional>
#include <memory>
#include <string>

#include "palpate/cameras/cameras.h"
#include "palpate/cloud/depth_source.h"
#include "palpate/io/files.h"

namespace palpate {

/// X_WC by time stamps.
class CameraPoses {
 public:
  /// Of a URI: its pose, or its file of poses. Errors: that of the file; both are given.
  static Result<CameraPoses> of(const CameraUri& uri);

  bool is_moving() const { return path_.size() > 1; }
  /// The camera stays where others take it to be: at the origin of W.
  bool is_at_origin() const { return path_.size() == 1 && path_.front().X_WT == Pose{}; }
  Pose at(double time) const { return pose_at(path_, time); }
  /// Of the first and the last pose of a camera that moves, s.
  double begin() const { return path_.front().time; }
  double end() const { return path_.back().time; }

 private:
  std::vector<TimedPose> path_;
};

/// The same frames with their poses. Of a camera that moves, frames for whose time there is no pose
/// are left out, and a note says so. Error: a camera that moves is live, whose clock no file knows.
Result<std::unique_ptr<DepthSource>> make_posed(std::unique_ptr<DepthSource> source,
                                                CameraPoses poses);

}  // namespace palpate
