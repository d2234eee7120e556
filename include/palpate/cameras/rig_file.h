// Several cameras in one file: where each of them is, and how it is opened.
#pragma once

#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "palpate/cameras/camera_uri.h"

namespace palpate {

/// A file, TOML:
///
///   [world]
///   frame = "table"          # of coordinates, as people call it
///   gravity = [0, 9.81, 0]   # m/s2, in W
///
///   [[camera]]
///   name = "front"
///   uri = "openni2"                          # as of open_camera
///   intrinsics = [525, 525, 319.5, 239.5]    # these win over the URI
///   distortion = [0.1, -0.2, 0, 0]
///   unit = 0.001
///   pose = [0, 0, 0, 0, 0, 0, 1]             # X_WC: tx ty tz qx qy qz qw
///   # or: pose_from = "front.tum"            # of a camera that moves, beside this file
///   # or: pose_from = "tf:front_optical"     # as the tf of a recording (bag:) tells of that frame
struct CameraRig {
  struct Camera {
    std::string name;
    CameraUri uri;
  };
  std::string frame = "world";
  std::optional<Vec3d> gravity;  ///< m/s2, in W; none: nobody knows
  std::vector<Camera> cameras;
};

/// Targets and files of poses that are relative are beside the rig's file. Errors: no such file,
/// not TOML, a key that is not known or has another kind of value, two cameras of one name, no
/// camera or more than kMostCameras; all with the file, and the camera.
Result<CameraRig> load_rig(const std::filesystem::path& path);
/// As text of such a file: of each camera its pose is written anew, everything else as it was read.
Result<std::string> rig_text_with_poses(const std::filesystem::path& path,
                                        const std::vector<Pose>& X_WC);

}  // namespace palpate
