
#include <cstdint>

#include "src/io/bags/mcap_format.h"
#include "src/io/internal/cdr.h"
#include "src/io/internal/ros_types.h"

namespace palpate { inline namespace v0 {
namespace {

using mcap::Cursor;

/// ROS 1 has no padding, no zero behind texts, and counts messages in their headers.
void turn(std::string_view type, Cursor& from, CdrWriter& to);

void turn_one(const RosField& field, Cursor& from, CdrWriter& to) {
  switch (field.base) {
    case RosBase::nested: turn(field.type, from, to); break;
    case RosBase::text: to.text(from.text()); break;
    case RosBase::int16:
    case RosBase::uint16: to.number(from.number<std::uint16_t>()); break;
    case RosBase::int32:
    case RosBase::uint32:
    case RosBase::float32: to.number(from.number<std::uint32_t>()); break;
    case RosBase::int64:
    case RosBase::uint64:
    case RosBase::float64: to.number(from.number<std::uint64_t>()); break;
    default: to.number(from.number<std::uint8_t>());
  }
}

void turn(std::string_view type, Cursor& from, CdrWriter& to) {
  if (type == "std_msgs/Header") from.number<std::uint32_t>();
  for (const RosField& field : ros_fields(type)) {
    const bool is_sequence = field.shape == RosField::Shape::sequence;
    if (is_sequence && field.base == RosBase::uint8) {
      const std::string_view bytes = from.text();
      to.bytes(bytes.data(), bytes.size());
      continue;
    }
    std::uint32_t count = field.shape == RosField::Shape::array ? field.count : 1;
    if (is_sequence) to.number(count = from.number<std::uint32_t>());
    for (std::uint32_t i = 0; i < count && from.is_good(); ++i) turn_one(field, from, to);
  }
}

}  // namespace

std::optional<std::string> cdr_of_ros1(std::string_view type, std::string_view message) {
  if (ros_fields(type).empty()) return std::nullopt;
  Cursor from(message);
  CdrWriter to;
  turn(type, from, to);
  if (!from.is_good()) return std::nullopt;
  return to.take();
}

}}  // namespace palpate::v0
