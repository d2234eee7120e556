// Messages of sensor_msgs/PointCloud2 in any layout.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <cstring>
#include <string>
#include <type_traits>
#include <vector>

#include "src/cloud/internal/cloud_camera.h"
#include "src/io/bags/mcap_format.h"
#include "src/io/internal/cdr.h"

namespace palpate::test {

struct CloudField {
  std::string name;
  std::uint32_t offset = 0;
  std::uint8_t type = 7;  // FLOAT32
  std::uint32_t count = 1;
};

/// Places of the numbers of a point in a message.
struct CloudLayout {
  std::vector<CloudField> fields{{"x", 0}, {"y", 4}, {"z", 8}};
  std::uint32_t point_step = 12, row_padding = 0;
  bool is_big = false;
  double scale = 1;  // m per number
  Vec3d shift = {};  // m, added to each point

  /// Three layouts: packed floats; PCL's, with a color between and padding; doubles in another
  /// order, big-endian, with longer rows.
  static std::vector<CloudLayout> three() {
    return {{},
            {{{"x", 0}, {"y", 4}, {"z", 8}, {"rgb", 16}}, 32},
            {{{"intensity", 0, 2}, {"z", 1, 8}, {"x", 9, 8}, {"y", 17, 8}}, 29, 7, true}};
  }
};

template <class Number>
void put_number(std::string& data, std::size_t at, double value, bool is_big) {
  const auto number =
      static_cast<Number>(std::is_integral_v<Number> && !std::isfinite(value) ? 0 : value);
  char bytes[sizeof number];
  std::memcpy(bytes, &number, sizeof number);
  if (is_big) std::reverse(std::begin(bytes), std::end(bytes));
  std::memcpy(data.data() + at, bytes, sizeof number);
}

inline std::string cloud_data(const PointsView& cloud, const CloudLayout& layout) {
  const std::size_t row =
      layout.point_step * static_cast<std::size_t>(cloud.width) + layout.row_padding;
  std::string data(row * static_cast<std::size_t>(cloud.height), '\x7f');
  for (std::size_t i = 0; i < cloud.points.size(); ++i) {
    const auto width = static_cast<std::size_t>(cloud.width);
    const std::size_t first = i / width * row + i % width * layout.point_step;
    for (const CloudField& field : layout.fields) {
      const std::size_t axis = std::string("xyz").find(field.name);
      const std::size_t size = field.type == 8 ? 8 : field.type == 3 ? 2 : 4;
      if (field.name.size() != 1 || axis > 2 || field.offset + size > layout.point_step) continue;
      const double value = (static_cast<double>(cloud.points[i][static_cast<int>(axis)]) +
                            layout.shift[static_cast<int>(axis)]) /
                           layout.scale;
      const std::size_t at = first + field.offset;
      switch (field.type) {
        case 3: put_number<std::int16_t>(data, at, value, layout.is_big); break;
        case 5: put_number<std::int32_t>(data, at, value, layout.is_big); break;
        case 8: put_number<double>(data, at, value, layout.is_big); break;
        default: put_number<float>(data, at, value, layout.is_big);
      }
    }
  }
  return data;
}

/// As ROS 2 sends it.
inline std::string cloud_message(const PointsView& cloud, const CloudLayout& layout = {},
                                 double stamp = 1, const std::string& frame = "cam") {
  CdrWriter to;
  to.number(static_cast<std::int32_t>(stamp));
  to.number(static_cast<std::uint32_t>(1e9 * (stamp - static_cast<std::int32_t>(stamp)) + 0.5));
  to.text(frame);
  to.number(static_cast<std::uint32_t>(cloud.height));
  to.number(static_cast<std::uint32_t>(cloud.width));
  to.number(static_cast<std::uint32_t>(layout.fields.size()));
  for (const CloudField& field : layout.fields) {
    to.text(field.name);
    to.number(field.offset);
    to.number(field.type);
    to.number(field.count);
  }
  to.number(std::uint8_t{layout.is_big});
  to.number(layout.point_step);
  to.number(layout.point_step * static_cast<std::uint32_t>(cloud.width) + layout.row_padding);
  const std::string data = cloud_data(cloud, layout);
  to.bytes(data.data(), data.size());
  to.number(std::uint8_t{0});
  return to.take();
}

/// The same as ROS 1 sends it, from its header on.
inline std::string ros1_cloud(mcap::Bytes header, const PointsView& cloud,
                              const CloudLayout& layout = {}) {
  header.number(static_cast<std::uint32_t>(cloud.height));
  header.number(static_cast<std::uint32_t>(cloud.width));
  header.number(static_cast<std::uint32_t>(layout.fields.size()));
  for (const CloudField& field : layout.fields) {
    header.text(field.name).number(field.offset).number(field.type).number(field.count);
  }
  header.number(std::uint8_t{layout.is_big}).number(layout.point_step);
  header.number(layout.point_step * static_cast<std::uint32_t>(cloud.width) + layout.row_padding);
  return header.text(cloud_data(cloud, layout)).number(std::uint8_t{0}).str();
}

}  // namespace palpate::test
