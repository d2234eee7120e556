#include "src/cameras/messages/cloud_messages.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "src/io/internal/cdr.h"
#include "src/io/internal/ros_image.h"
#include "src/io/internal/text_scanner.h"

namespace palpate { inline namespace v0 {
namespace {

Error left_out(const CameraUri& uri, const std::string& parameter, const std::string& why) {
  return {Errc::invalid_argument,
          "camera " + uri.text.substr(0, 60) + ": leave out '" + parameter + "': " + why};
}

/// Sets the vector of a parameter such as viewpoint=x,y,z, if it is given.
Status set_vector(const CameraUri& uri, const char* name, const char* what,
                  std::optional<Vec3d>& to) {
  const auto given = uri.extras.find(name);
  if (given == uri.extras.end()) return Done{};
  std::string_view rest = given->second;
  Vec3d vector;
  bool is_good = true;
  for (int axis = 0; axis < 3; ++axis) {
    const std::size_t end = axis < 2 ? rest.find(',') : rest.size();
    const auto number = parse_number<double>(rest.substr(0, end));
    is_good = is_good && number && std::isfinite(*number) && end != rest.npos;
    if (!is_good) break;
    vector[axis] = *number;
    rest.remove_prefix(std::min(end + 1, rest.size()));
  }
  to = vector;
  if (is_good && norm(vector) < 1e8) return Done{};
  return Error{Errc::invalid_argument, "camera " + uri.text.substr(0, 60) + ": '" + name +
                                           "' must be " + what + ", not '" +
                                           given->second.substr(0, 60) + "'"};
}

}  // namespace

Result<CloudCameraOptions> cloud_options(const CameraUri& uri) {
  for (const char* name : {"info", "flow"}) {
    if (uri.extras.contains(name))
      return left_out(uri, name, "it is of depth images, not of clouds");
  }
  if (uri.distortion) return left_out(uri, "distortion", "points have no lens");
  CloudCameraOptions options;
  if (const Status status =
          set_vector(uri, "viewpoint", "x,y,z in m, in the frame of the cloud", options.viewpoint);
      !status) {
    return status.error();
  }
  if (const Status status =
          set_vector(uri, "look",
                     "x,y,z, a direction in the frame of the cloud, or round where a program takes "
                     "several --camera",
                     options.look);
      !status) {
    return status.error();
  }
  if (options.look && !(norm(*options.look) > 1e-6)) {
    return Error{Errc::invalid_argument,
                 "camera " + uri.text.substr(0, 60) + ": 'look' must be longer than 0"};
  }
  options.intrinsics = uri.intrinsics;
  options.unit = uri.unit;
  if (uri.size) {
    options.width = uri.size->width;
    options.height = uri.size->height;
  }
  return options;
}

Status check_for_images(const CameraUri& uri) {
  if (uri.size) {
    return left_out(uri, "size", "the images of " + uri.kind + " say their size themselves");
  }
  for (const char* name : {"viewpoint", "look"}) {
    if (uri.extras.contains(name))
      return left_out(uri, name, "it is of clouds, not of depth images");
  }
  return Done{};
}

Result<DepthFrame> CloudMessages::read(std::string_view message) {
  if (const Status status =
          read_point_cloud(message, scale_, options_.viewpoint.value_or(Vec3d{}), points_);
      !status) {
    return status.error();
  }
  if (!camera_) {
    auto camera = CloudCamera::create(points_.view(), options_);
    if (!camera) return camera.error();
    camera_ = *std::move(camera);
  }
  DepthFrame frame;
  const CloudShares shares = camera_->take(points_.view(), frame);
  CdrReader from(message);
  frame.timestamp = read_ros_header(from).time;
  if (!shares.is_image && !std::exchange(has_note_, true)) note_ = shares.text();
  return frame;
}

std::string CloudMessages::take_note() { return std::exchange(note_, {}); }

}}  // namespace palpate::v0
