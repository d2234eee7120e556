// Compressed depth images and camera models as ROS 2 sends them (CDR, little-endian).
#pragma once

#include <optional>
#include <string>
#include <string_view>

#include "palpate/cameras/cameras.h"
#include "src/cloud/internal/frame_limits.h"

namespace palpate { inline namespace v0 {

/// Returns meters per number of 32FC1 images and of points, by `scale=`; else 1. Error: an invalid
/// number.
Result<double> scale_of_numbers(const CameraUri& uri);

/// sensor_msgs/CompressedImage of the transport compressedDepth: PNG or RVL of 16UC1 or 32FC1; or
/// a PNG of 16 bits, by what the bytes are and whatever their format is called. Errors: another
/// format, a damaged image.
Result<DepthFrame> read_compressed_depth(std::string_view message, double unit, double scale = 1);

struct RosCameraModel {
  int width = 0, height = 0;  ///< of all that the camera sees
  struct Region {
    int x = 0, y = 0, width = 0, height = 0;  ///< pixels of it; 0 x 0: all
    friend bool operator==(const Region&, const Region&) = default;
  };
  Region roi;                 ///< what the images show of it, maybe with fewer pixels (binning)
  Intrinsics raw, rectified;  ///< matrix K, and P of the undistorted image; fx = 0: not given
  Distortion distortion;      ///< of the raw image
  std::string unknown_lens;   ///< why it is not known for the raw image; empty: it is
  friend bool operator==(const RosCameraModel&, const RosCameraModel&) = default;
};
/// sensor_msgs/CameraInfo. Errors: a damaged message.
Result<RosCameraModel> read_camera_model(std::string_view message);
/// Errors: it has no intrinsics for images on that topic, as a camera that is not calibrated sends
/// 0; they are not rectified, and of a lens other than plumb_bob and rational_polynomial.
Status check_ros_camera(const RosCameraModel& camera, const std::string& topic);
/// Sets intrinsics and distortion of the images on that topic, for the size that `info` has. Images
/// of the whole size are taken as whole, whatever the region.
void set_ros_camera(const RosCameraModel& camera, const std::string& topic, DepthStreamInfo& info);

/// The topic without the transport that is written behind it: "/camera/depth/image_raw" of
/// "/camera/depth/image_raw/compressedDepth".
inline std::string_view ros_image_topic(std::string_view topic) {
  for (const std::string_view transport : {"/compressedDepth", "/compressed"}) {
    if (topic.ends_with(transport)) return topic.substr(0, topic.size() - transport.size());
  }
  return topic;
}

/// "/camera/depth" of "/camera/depth/image_rect_raw".
inline std::string_view ros_parent(std::string_view topic) {
  return topic.substr(0, topic.rfind('/'));
}

}}  // namespace palpate::v0
