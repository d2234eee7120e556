// Messages of ROS 1: the same fields as those of ROS 2, in other bytes.
#pragma once

#include <optional>
#include <string>
#include <string_view>

namespace palpate { inline namespace v0 {

/// A message of ROS 1 in the bytes that ROS 2 would send it in (CDR), so that one reader serves
/// both. `type` as "sensor_msgs/Image". None: the type is not known here (ros_fields), or the
/// message is shorter than its fields.
std::optional<std::string> cdr_of_ros1(std::string_view type, std::string_view message);

}}  // namespace palpate::v0
