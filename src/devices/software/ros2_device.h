// A tool held by a robot as a device: its pose comes over ROS 2, and it gets no force.
#pragma once

#include <string>
#include <string_view>

#include "palpate/core/core.h"

namespace palpate { inline namespace v0 {

/// "/topic[@FRAME]": geometry_msgs/PoseStamped, transformed to FRAME if that is given and the
/// message names another one. "FRAME@BASE": a frame of tf, in the frame BASE. Behind both:
/// "?max_age=S" and "&clock=own|shared".
struct Ros2ToolAddress {
  std::string topic, frame, base;  ///< either a topic or a frame
  double max_age = 0.1;            ///< s: a pose counts as current until then
  bool has_our_clock = false;      ///< stamps are of this computer's clock and date the poses
};
/// Errors: neither of them, an unknown parameter.
Result<Ros2ToolAddress> parse_ros2_tool(std::string_view address);

}}  // namespace palpate::v0
