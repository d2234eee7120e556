// Files of tools and of trajectories.
#pragma once

#include <filesystem>
#include <string>
#include <string_view>
#include <vector>

#include "palpate/core/core.h"
#include "palpate/math/geometry.h"
#include "palpate/tool/tool.h"

namespace palpate::inline v0 {

// The tool file (.palp): one versioned, checksummed file with mesh, spheres and leaf graph.

/// Writes to a temporary beside `path`, then renames: never half a file.
Status save_tool(const Tool& tool, const std::filesystem::path& path);

/// Errors: not a tool file, newer version, truncated, checksum does not match, values out of range.
/// Sizes are checked against the file's length before anything is allocated.
Result<Tool> load_tool(const std::filesystem::path& path);

/// What such a file holds. Errors: as above; messages begin with what is wrong, not with a name.
Result<std::string> tool_to_bytes(const Tool& tool);
Result<Tool> tool_from_bytes(std::string_view bytes);

// Pose files in TUM format.

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

}  // namespace palpate::inline v0
