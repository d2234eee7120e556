// A tool held by a robot as a device: its pose comes over ROS 2, and it gets no force.
#pragma once

#include <string>
#include <string_view>

#include "palpate/core/core.h"

namespace palpate::inline v0 {

/// "/topic[@FRAME]": geometry_msgs/PoseStamped, transformed to FRAME if that is given and the
/// message names another one. "FRAME@BASE": a frame of tf, in the frame BASE.
struct Ros2ToolAddress {
  std::string topic, frame, base;  ///< either a topic or a frame
};
/// Error: neither of them.
Result<Ros2ToolAddress> parse_ros2_tool(std::string_view address);

}  // namespace palpate::inline v0
