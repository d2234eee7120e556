// The messages of ROS 2 that recordings hold, so that its tools show them without ours.
#pragma once

#include <cstdint>
#include <functional>
#include <span>
#include <string>
#include <string_view>

#include "palpate/cloud/depth_source.h"
#include "palpate/math/pose.h"
#include "palpate/tool/tool.h"

namespace palpate {

/// Definition of a message type with those of all types in it, e.g. of "sensor_msgs/Image".
/// `more(type)` is the text of a type that is not of ROS.
std::string message_schema(
    const std::string& type, const std::function<std::string(const std::string&)>& more =
                                 [](const std::string&) { return std::string(); });

/// When, in ns since 1970 (or since the run began), and in which frame.
struct RosHeader {
  std::uint64_t time = 0;
  std::string_view frame;
};

/// 16UC1: counts as they were measured. read_depth_image of io/ros_image.h reads it.
std::string image_message(const RosHeader& header, const DepthFrame& frame);
std::string camera_info_message(const RosHeader& header, const DepthStreamInfo& stream);
/// sensor_msgs/PointCloud2 with float32 x, y, z in the camera frame, m: the measured pixels of
/// every n-th row and column, so that there are at most kMostRecordedPoints.
inline constexpr int kMostRecordedPoints = 20000;
std::string points_message(const RosHeader& header, const DepthFrame& frame,
                           const Intrinsics& intrinsics);

struct RosTransform {
  std::string_view parent, child;
  Pose X_PC;
};
std::string transform_message(std::uint64_t time, std::span<const RosTransform> transforms);
/// Force and torque at the origin of the header's frame, in its axes.
std::string wrench_message(const RosHeader& header, const Wrench& wrench);
/// The tool's mesh, at rest in its frame; of large ones every n-th triangle.
std::string tool_marker_message(const RosHeader& header, const TriangleMesh& mesh);

}  // namespace palpate
