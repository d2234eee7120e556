// Message types of ROS 2: their definitions, and data derived from them. One text per type serves
// recordings (the schema), DDS (the layout of a message in memory) and the type's hash.
#pragma once

#include <cstdint>
#include <functional>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

namespace palpate { inline namespace v0 {

/// The numbers are those of type_description_interfaces/FieldType.
enum class RosBase : std::uint8_t {
  nested = 1,
  int8 = 2,
  uint8 = 3,
  int16 = 4,
  uint16 = 5,
  int32 = 6,
  uint32 = 7,
  int64 = 8,
  uint64 = 9,
  float32 = 10,
  float64 = 11,
  character = 13,
  boolean = 15,
  byte = 16,
  text = 17,
};

struct RosField {
  enum class Shape : std::uint8_t { single, array, sequence };

  std::string name;
  RosBase base = RosBase::nested;
  std::string type;  ///< of a nested one: "std_msgs/Header"
  Shape shape = Shape::single;
  std::uint32_t count = 0;     ///< of an array
  std::uint32_t max_text = 0;  ///< bytes of a bounded text; 0: any
};

/// Returns the fields of a type such as "sensor_msgs/Image"; empty: it is not known here.
const std::vector<RosField>& ros_fields(std::string_view type);

/// Definition of a message type with those of all types in it. `more(type)` is the text of a type
/// that is not known here.
std::string message_schema(
    const std::string& type, const std::function<std::string(const std::string&)>& more =
                                 [](const std::string&) { return std::string(); });

/// "RIHS01_" and 64 digits (REP 2016): peers compare it, and tools find definitions by it.
std::string ros_type_hash(const std::string& type);

/// "sensor_msgs/msg/Image" and "sensor_msgs::msg::dds_::Image_" of "sensor_msgs/Image".
std::string ros_interface_name(std::string_view type);
std::string dds_type_name(std::string_view type);

/// A message of ROS 1 in the bytes that ROS 2 would send it in (CDR), so that one reader serves
/// both. `type` as "sensor_msgs/Image". None: the type is not known here (ros_fields), or the
/// message is shorter than its fields.
std::optional<std::string> cdr_of_ros1(std::string_view type, std::string_view message);

}}  // namespace palpate::v0
