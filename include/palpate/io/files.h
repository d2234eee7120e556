// Tool files (.palp) and trajectory files (TUM).
#pragma once

#include <filesystem>
#include <string>
#include <string_view>
#include <vector>

#include "palpate/core/core.h"
#include "palpate/math/geometry.h"
#include "palpate/tool/tool.h"

namespace palpate { inline namespace v0 {

// The tool file (.palp): one versioned file with checksum, mesh, spheres and leaf graph.

/// Writes to a temporary file beside `path`, then renames it: never leaves half a file.
Status save_tool(const Tool& tool, const std::filesystem::path& path);

/// Reads a tool file. Errors: not a tool file, newer version, truncated, checksum mismatch, values
/// out of range. Checks sizes against the file's length before any allocation.
Result<Tool> load_tool(const std::filesystem::path& path);

/// The same in memory. Errors: as above, without a file name in the message.
Result<std::string> tool_to_bytes(const Tool& tool);
Result<Tool> tool_from_bytes(std::string_view bytes);

// Pose files in TUM format.

/// A pose of the tool at a time.
struct TimedPose {
  double time = 0;  ///< seconds
  Pose X_WT;
};

/// Reads lines "t tx ty tz qx qy qz qw", # comments, blank lines (s, m). Quaternions are
/// normalized. Errors, with the line number: no pose, wrong number of values, not finite, zero
/// quaternion, time going backwards.
Result<std::vector<TimedPose>> load_trajectory(const std::filesystem::path& path);
Status save_trajectory(const std::vector<TimedPose>& poses, const std::filesystem::path& path);

/// Parses "tx ty tz qx qy qz qw" (m, unit quaternion).
Result<Pose> parse_pose(std::string_view text);

/// Pose at a time (s): interpolated (slerp), clamped at both ends. `poses` must not be empty.
Pose pose_at(const std::vector<TimedPose>& poses, double time);

}}  // namespace palpate::v0
