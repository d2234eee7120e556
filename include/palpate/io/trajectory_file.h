// Pose files in TUM format.
#pragma once

#include <filesystem>
#include <string_view>
#include <vector>

#include "palpate/core/result.h"
#include "palpate/math/pose.h"

namespace palpate {

struct TimedPose {
  double time = 0;  ///< seconds
  Pose X_WT;
};

/// Lines "t tx ty tz qx qy qz qw", # comments, blank lines. Quaternions are normalised. Errors: no
/// pose, wrong number of values, not finite, zero quaternion, time going backwards; all with the
/// line number.
Result<std::vector<TimedPose>> load_trajectory(const std::filesystem::path& path);
Status save_trajectory(const std::vector<TimedPose>& poses, const std::filesystem::path& path);

/// "tx ty tz qx qy qz qw".
Result<Pose> parse_pose(std::string_view text);

/// Pose at a time: slerp between neighbours, clamped at both ends. `poses` must not be empty.
Pose pose_at(const std::vector<TimedPose>& poses, double time);

}  // namespace palpate
