#include <algorithm>
#include <array>
#include <cstdint>
#include <cstring>
#include <span>
#include <string>
#include <vector>

#include "src/cloud/internal/cloud_camera.h"
#include "src/io/internal/cdr.h"
#include "src/io/internal/ros_image.h"

namespace palpate { inline namespace v0 {
namespace {

Error bad(const std::string& what) { return {Errc::bad_input, "a point cloud " + what}; }

/// sensor_msgs/PointField: INT8 is 1, FLOAT64 is 8.
constexpr std::array<std::size_t, 9> kSizes{0, 1, 1, 2, 2, 4, 4, 4, 8};

struct PointField {
  std::size_t offset = 0;
  int type = 0;  // 0: there is none of that name
};

template <class Number>
double value_at(const char* at, bool is_big) {
  std::array<char, sizeof(Number)> bytes;
  std::memcpy(bytes.data(), at, sizeof(Number));
  if (is_big) std::ranges::reverse(bytes);
  Number value;
  std::memcpy(&value, bytes.data(), sizeof value);
  return static_cast<double>(value);
}

double value_at(const char* at, int type, bool is_big) {
  switch (type) {
    case 1: return value_at<std::int8_t>(at, is_big);
    case 2: return value_at<std::uint8_t>(at, is_big);
    case 3: return value_at<std::int16_t>(at, is_big);
    case 4: return value_at<std::uint16_t>(at, is_big);
    case 5: return value_at<std::int32_t>(at, is_big);
    case 6: return value_at<std::uint32_t>(at, is_big);
    case 7: return value_at<float>(at, is_big);
    default: return value_at<double>(at, is_big);
  }
}

constexpr std::array<std::string_view, 6> kNames{"x", "y", "z", "normal_x", "normal_y", "normal_z"};
using PointFields = std::array<PointField, kNames.size()>;

/// Reads the list of fields. Errors: a coordinate twice, or not at all.
Result<PointFields> take_fields(CdrReader& from) {
  PointFields fields;
  std::string names;
  const auto num = from.number<std::uint32_t>();
  for (std::uint32_t i = 0; i < num && from.is_good(); ++i) {
    const std::string_view name = from.text();
    const std::size_t offset = from.number<std::uint32_t>();
    const int type = from.number<std::uint8_t>();
    from.number<std::uint32_t>();  // count: 1, and some senders write 0
    if (!from.is_good()) break;
    if (names.size() < 100) names += (names.empty() ? "" : ", ") + std::string(name.substr(0, 40));
    const auto known = std::ranges::find(kNames, name);
    if (known == kNames.end()) continue;
    const std::string said = "has the field '" + std::string(name) + "' ";
    PointField& field = fields[static_cast<std::size_t>(known - kNames.begin())];
    if (field.type != 0) return bad(said + "twice; it must be there once");
    if (type < 1 || type > 8) return bad(said + "of the unknown type " + std::to_string(type));
    field = {offset, type};
  }
  if (!from.is_good()) return bad("is damaged: it ends in its list of fields");
  for (std::size_t axis = 0; axis < 3; ++axis) {
    if (fields[axis].type != 0) continue;
    return bad("has no field '" + std::string(kNames[axis]) + "' but " +
               (names.empty() ? "none" : names) + "; a cloud needs x, y and z");
  }
  return fields;
}

}  // namespace

Status read_point_cloud(std::string_view message, double scale, const Vec3d& eye,
                        CloudPoints& points) {
  CdrReader from(message);
  read_ros_header(from);
  const auto height = from.number<std::uint32_t>(), width = from.number<std::uint32_t>();
  const auto taken = take_fields(from);
  if (!taken) return taken.error();
  const PointFields& fields = *taken;
  const bool is_big = from.number<std::uint8_t>() != 0;
  const std::size_t point_step = from.number<std::uint32_t>();
  const std::size_t row_step = from.number<std::uint32_t>();
  const std::string_view data = from.bytes();
  if (!from.is_good()) return bad("is damaged: it ends before its points do");
  const std::string size = std::to_string(width) + " x " + std::to_string(height) + " points";
  if (width == 0 || height == 0) return bad("has no points");
  if (width > kMaxCloudPoints / height) {
    return bad("of " + size + " has more than " + std::to_string(kMaxCloudPoints) +
               "; thin it before it is sent");
  }
  for (std::size_t i = 0; i < kNames.size(); ++i) {
    const auto& [offset, type] = fields[i];
    if (type == 0 || offset + kSizes[static_cast<std::size_t>(type)] <= point_step) continue;
    return bad("has a point_step of " + std::to_string(point_step) + " bytes, and its field '" +
               std::string(kNames[i]) + "' lies beyond; correct what sends it");
  }
  if (height > 1 && row_step < point_step * width) {
    return bad("has a row_step of " + std::to_string(row_step) + " bytes, and a row of " + size +
               " takes " + std::to_string(point_step * width) + "; correct what sends it");
  }
  if (data.size() < row_step * (height - 1) + point_step * width) {
    return bad("of " + size + " claims more bytes than the " + std::to_string(data.size()) +
               " that it has; correct what sends it");
  }
  const bool has_normals = fields[3].type != 0 && fields[4].type != 0 && fields[5].type != 0;
  const std::size_t num = std::size_t{width} * height;
  points.width = static_cast<int>(width);
  points.height = static_cast<int>(height);
  points.points.resize(num);
  points.normals.resize(has_normals ? num : 0);
  const auto read_three = [&](std::size_t first, double factor, const Vec3d& origin,
                              std::vector<Vec3f>& to) {
    const std::span three = std::span(fields).subspan(first, 3);
    for (std::size_t i = 0; i < num; ++i) {
      const char* const at = data.data() + i / width * row_step + i % width * point_step;
      Vec3d p;
      for (int axis = 0; axis < 3; ++axis) {
        const auto& [offset, type] = three[static_cast<std::size_t>(axis)];
        p[axis] = factor * value_at(at + offset, type, is_big);
      }
      to[i] = to_float(p == Vec3d{} ? p : p - origin);  // 0 0 0 is no measurement
    }
  };
  read_three(0, scale, eye, points.points);
  if (has_normals) read_three(3, 1, {}, points.normals);
  return Done{};
}

}}  // namespace palpate::v0
