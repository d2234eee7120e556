// The formats of bags beside MCAP, and what readers of bags share.
#pragma once

#include <cstdint>
#include <filesystem>
#include <memory>
#include <string_view>

#include "src/io/internal/bag_file.h"

namespace palpate::inline v0 {

inline constexpr std::string_view kRos1Magic = "#ROSBAG V2.0\n";
/// Format 2.0 of ROS 1, with chunks by LZ4, bzip2 or as they are; its index is not needed.
Result<std::unique_ptr<BagReader>> open_ros1_bag(const std::filesystem::path& path);

inline constexpr std::string_view kSqliteMagic{"SQLite format 3\0", 16};
/// What rosbag2 and RealSense cameras write.
Result<std::unique_ptr<BagReader>> open_sqlite_bag(const std::filesystem::path& path);

/// The system cannot read there, though the file is longer: it is not cut off.
Error unreadable(const std::filesystem::path& path, std::uint64_t place);

}  // namespace palpate::inline v0
