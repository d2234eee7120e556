// Compressed depth images and camera models as ROS 2 sends them (CDR, little-endian).
#pragma once

#include <optional>
#include <string_view>

#include "palpate/cloud/depth_source.h"

namespace palpate {

/// sensor_msgs/CompressedImage of the transport compressedDepth: PNG of 16UC1 or 32FC1. Errors:
/// another format, a damaged image.
Result<DepthFrame> read_compressed_depth(std::string_view message, double unit);

struct RosCameraModel {
  int width = 0, height = 0;
  Intrinsics raw, rectified;  ///< matrix K, and P of the undistorted image; fx = 0: not given
  Distortion distortion;      ///< of the raw image
};
/// sensor_msgs/CameraInfo. Errors: a distortion model other than plumb_bob and rational_polynomial,
/// a damaged message.
Result<RosCameraModel> read_camera_model(std::string_view message);

}  // namespace palpate
