// Depth streams alone, kept as a recording that ROS 2 tools read.
#pragma once

#include <cstdint>
#include <filesystem>
#include <functional>
#include <limits>
#include <string>
#include <vector>

#include "palpate/cloud/depth_source.h"

namespace palpate { inline namespace v0 {

struct RecordStreamOptions {
  double duration = std::numeric_limits<double>::infinity();  ///< s, by the time stamps
  /// Called before every frame, from one thread at a time; false ends the recording, which is kept.
  std::function<bool(double seconds, std::uint64_t num_frames)> keep_going = {};
};

struct StreamRecording {
  std::uint64_t num_frames = 0, num_bytes = 0;
  std::vector<std::uint64_t> frames_of;  ///< of each camera
  double seconds = 0;  ///< between the first time stamp and the last of a camera, the longest
  std::vector<std::string> notes;
};

/// Writes an MCAP file with /camera/depth/image_rect_raw (sensor_msgs/Image of 16UC1, the counts as
/// they are), /camera/depth/camera_info, /camera/depth/unit (meters per count, which ROS takes for
/// 0.001) and /tf_static or /tf; /camera_2/... of a second camera. Live frames are stamped with
/// their capture time since 1970 and written as they come, others with their own time stamps and in
/// their order: the same bytes every time. Live cameras end together. The file is whole or absent:
/// where a source or the disk fails later, what there is stays under the name PATH.partial, which
/// the error names. Errors: a source, the disk, a camera without any frame.
Result<StreamRecording> record_stream(const DepthSources& sources,
                                      const std::filesystem::path& path,
                                      const RecordStreamOptions& options = {});

}}  // namespace palpate::v0
