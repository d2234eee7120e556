// Point clouds of ROS as images of one stream, and the parameters of a URI that are of clouds.
#pragma once

#include <optional>
#include <string>
#include <string_view>

#include "palpate/cameras/cameras.h"
#include "src/cloud/internal/cloud_camera.h"

namespace palpate { inline namespace v0 {

/// Parameters of a URI for clouds: viewpoint=, look=, size=, intrinsics=, unit=. Error: a value
/// that is no such, a parameter that is of images.
Result<CloudCameraOptions> cloud_options(const CameraUri& uri);
/// Error: a parameter of clouds for a stream of images.
Status check_for_images(const CameraUri& uri);

/// Turns the PointCloud2 messages of a stream into images of one camera, that of the first one.
class CloudMessages {
 public:
  CloudMessages(const CloudCameraOptions& options, double scale)
      : options_(options), scale_(scale) {}

  /// Reads a message. DepthFrame::timestamp is the header's. Error: why it is none; of the first
  /// one, why no camera is made of it.
  Result<DepthFrame> read(std::string_view message);
  /// None before the first good message.
  const std::optional<CloudCamera>& camera() const { return camera_; }
  /// Returns the shares of the first projected cloud as a note, once; else nothing.
  std::string take_note();

 private:
  CloudCameraOptions options_;
  double scale_ = 1;
  CloudPoints points_;
  std::optional<CloudCamera> camera_;
  std::string note_;
  bool has_note_ = false;
};

}}  // namespace palpate::v0
