// A depth stream alone, kept as a recording that ROS 2 tools read.
#pragma once

#include <cstdint>
#include <filesystem>
#include <functional>
#include <limits>
#include <string>
#include <vector>

#include "palpate/cloud/depth_source.h"

namespace palpate {

struct RecordStreamOptions {
  double duration = std::numeric_limits<double>::infinity();  ///< s, by the time stamps
  /// Asked before every frame; false ends the recording, which is kept.
  std::function<bool(double seconds, std::uint64_t num_frames)> keep_going = {};
};

struct StreamRecording {
  std::uint64_t num_frames = 0, num_bytes = 0;
  double seconds = 0;  ///< between the first time stamp and the last
  std::vector<std::string> notes;
};

/// Writes an MCAP file with /camera/depth/image_rect_raw (sensor_msgs/Image of 16UC1, the counts as
/// they are), /camera/depth/camera_info, /camera/depth/unit (metres per count, which ROS takes for
/// 0.001) and /tf_static. Live frames are stamped with their capture time since 1970, others with
/// their own time stamps. The file is whole or absent. Errors: the source, the disk, no frame.
Result<StreamRecording> record_stream(DepthSource& source, const std::filesystem::path& path,
                                      const RecordStreamOptions& options = {});

}  // namespace palpate
