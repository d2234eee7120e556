#include "src/io/internal/ros_image.h"

#include <algorithm>
#include <array>
#include <cstring>
#include <string>

#include "src/cloud/internal/frame_limits.h"
#include "src/io/internal/cdr.h"

namespace palpate { inline namespace v0 {
namespace {

constexpr double kMillimeter = 0.001;

Error damaged() { return {Errc::bad_input, "a depth image is damaged"}; }

/// Reads a number at any position, as rows may be longer than their pixels, in either byte order.
template <class Number>
Number value_at(std::string_view data, std::size_t at, bool is_big) {
  std::array<char, sizeof(Number)> bytes;
  std::memcpy(bytes.data(), data.data() + at, sizeof(Number));
  if (is_big) std::reverse(bytes.begin(), bytes.end());
  Number value;
  std::memcpy(&value, bytes.data(), sizeof value);
  return value;
}

}  // namespace

RosStamp read_ros_header(CdrReader& from) {
  const auto seconds = from.number<std::int32_t>();
  const auto nanoseconds = from.number<std::uint32_t>();
  return {seconds + 1e-9 * nanoseconds, from.text()};
}

Result<DepthFrame> read_depth_image(std::string_view message, double unit, double scale) {
  CdrReader from(message);
  DepthFrame frame;
  frame.timestamp = read_ros_header(from).time;
  const auto height = from.number<std::uint32_t>(), width = from.number<std::uint32_t>();
  const std::string_view encoding = from.text();
  const bool is_big = from.number<std::uint8_t>() != 0;
  const std::size_t step = from.number<std::uint32_t>();
  const std::string_view data = from.bytes();
  if (!from.is_good()) return damaged();
  const bool is_count = encoding == "16UC1" || encoding == "mono16";
  if (!is_count && encoding != "32FC1") {
    return Error{Errc::bad_input, "an image is of the encoding '" +
                                      std::string(encoding.substr(0, 40)) +
                                      "'; depth is 16UC1 or 32FC1"};
  }
  const std::size_t bytes = is_count ? 2 : 4;
  if (width < 1 || height < 1 || width > kMaxImageWidth || height > kMaxImageHeight ||
      step < bytes * width || data.size() < step * (height - 1) + bytes * width) {
    return damaged();
  }
  frame.width = static_cast<int>(width);
  frame.height = static_cast<int>(height);
  frame.unit = is_count ? kMillimeter : unit;
  frame.pixels.resize(std::size_t{width} * height);
  for (std::size_t v = 0; v < height; ++v) {
    std::uint16_t* const row = frame.pixels.data() + v * width;
    if (is_count && !is_big) {
      std::memcpy(row, data.data() + v * step, 2 * std::size_t{width});
      continue;
    }
    for (std::size_t u = 0; u < width; ++u) {
      const std::size_t at = v * step + u * bytes;
      row[u] = is_count
                   ? value_at<std::uint16_t>(data, at, is_big)
                   : count_of(scale * static_cast<double>(value_at<float>(data, at, is_big)), unit);
    }
  }
  return frame;
}

Result<std::vector<float>> read_flow_image(std::string_view message) {
  CdrReader from(message);
  read_ros_header(from);
  const auto height = from.number<std::uint32_t>(), width = from.number<std::uint32_t>();
  const std::string_view encoding = from.text();
  from.number<std::uint8_t>();
  from.number<std::uint32_t>();
  const std::string_view data = from.bytes();
  if (!from.is_good() || encoding != "32FC2" || data.empty() || width > kMaxImageWidth ||
      height > kMaxImageHeight || data.size() != 2 * sizeof(float) * width * height) {
    return Error{Errc::bad_input, "an optical flow is damaged"};
  }
  std::vector<float> flow(data.size() / sizeof(float));
  std::memcpy(flow.data(), data.data(), data.size());
  return flow;
}

}}  // namespace palpate::v0
