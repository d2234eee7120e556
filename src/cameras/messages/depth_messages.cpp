#include "src/cameras/messages/depth_messages.h"

#include <algorithm>
#include <cctype>
#include <cmath>
#include <cstring>
#include <string>
#include <vector>

#include "palpate/io/formats.h"
#include "src/cameras/stream/raw_frames.h"
#include "src/cloud/internal/lens_table.h"
#include "src/io/internal/cdr.h"
#include "src/io/internal/ros_image.h"
#include "src/io/internal/text_scanner.h"

namespace palpate { inline namespace v0 {
namespace {

constexpr double kMillimeter = 0.001;
constexpr std::string_view kPng = "\x89PNG";  // first bytes of such a file

Error damaged(const char* what) { return {Errc::bad_input, std::string(what) + " is damaged"}; }

bool is_positive(const Intrinsics& k) {
  return k.fx > 0 && k.fy > 0 && std::isfinite(k.fx + k.fy + k.cx + k.cy);
}

/// True for a rectified topic: P is the image's camera and distortion has been removed.
bool is_rectified(const RosCameraModel& camera, const std::string& topic) {
  const std::string_view image = ros_image_topic(topic);
  return image.substr(image.rfind('/') + 1).find("rect") != std::string_view::npos &&
         is_positive(camera.rectified);
}

/// True for models whose images are no pinhole's even if all coefficients are 0: r = f theta.
bool is_fisheye(std::string model) {
  std::ranges::transform(model, model.begin(),
                         [](unsigned char c) { return static_cast<char>(std::tolower(c)); });
  const auto has = [&](const char* word) { return model.find(word) != std::string::npos; };
  return has("equidistant") || has("fisheye") || has("kannala");
}

Error damaged_info() { return {Errc::bad_input, "a camera_info is damaged; record it again"}; }

}  // namespace

Result<double> scale_of_numbers(const CameraUri& uri) {
  constexpr double kMin = 1e-6, kMax = 1000;
  const auto given = uri.extras.find("scale");
  if (given == uri.extras.end()) return 1.0;
  const auto scale = parse_number<double>(given->second);
  if (scale && *scale >= kMin && *scale <= kMax) return *scale;
  return Error{Errc::invalid_argument,
               "camera " + uri.text +
                   ": 'scale' must be meters per number of a 32FC1 image, e.g. "
                   "0.001 for millimeters, not '" +
                   given->second.substr(0, 40) + "'"};
}

Result<DepthFrame> read_compressed_depth(std::string_view message, double unit, double scale) {
  // Before the PNG: the kind of compression, and the two numbers of a depth that was turned into
  // counts as count = a / depth + b.
  struct Config {
    std::int32_t kind;
    float a, b;
  };
  CdrReader from(message);
  const double stamp = read_ros_header(from).time;
  const std::string_view format = from.text();
  const std::string_view data = from.bytes();
  constexpr const char* kWhat = "a compressed depth image";
  if (from.is_good() && data.starts_with("\xff\xd8\xff")) {
    return Error{Errc::bad_input,
                 "an image is a JPEG, which keeps 8 bits and so has lost the depth; record the "
                 "image itself, or by the transport compressedDepth"};
  }
  // The transport `compressed`, or OpenCV.
  if (from.is_good() && data.starts_with(kPng)) {
    auto frame = decode_depth_png(data, kWhat, kMillimeter);
    if (frame) frame->timestamp = stamp;
    return frame;
  }
  if (!from.is_good() || data.size() < sizeof(Config)) return damaged(kWhat);
  const std::string_view image = data.substr(sizeof(Config));
  // "16UC1; compressedDepth rvl"; without a word behind it, it is PNG.
  constexpr std::string_view kTransport = "compressedDepth";
  const std::size_t at = format.find(kTransport);
  std::string_view codec =
      at == std::string_view::npos ? "none" : format.substr(at + kTransport.size());
  while (codec.starts_with(' ')) codec.remove_prefix(1);
  while (codec.ends_with(' ')) codec.remove_suffix(1);
  const bool is_png = image.starts_with(kPng), is_rvl = !is_png && codec == "rvl";
  if (!is_png && !is_rvl && codec != "png" && !codec.empty()) {
    return Error{Errc::bad_input, "an image is of the format '" +
                                      std::string(format.substr(0, 60)) +
                                      "'; depth is PNG of 16 bits, 'compressedDepth png' or "
                                      "'compressedDepth rvl'"};
  }
  Config config;
  std::memcpy(&config, data.data(), sizeof config);
  auto frame = is_rvl ? decode_depth_rvl(image, kWhat, kMillimeter)
                      : decode_depth_png(image, kWhat, kMillimeter);
  if (!frame) return frame.error();
  frame->timestamp = stamp;
  if (format.starts_with("32FC1")) {
    for (std::uint16_t& count : frame->pixels) {
      const double depth =
          count == 0 ? 0.0
                     : static_cast<double>(config.a) / (count - static_cast<double>(config.b));
      count = count_of(scale * depth, unit);
    }
    frame->unit = unit;
  }
  return frame;
}

Result<RosCameraModel> read_camera_model(std::string_view message) {
  CdrReader from(message);
  read_ros_header(from);
  RosCameraModel camera;
  camera.height = static_cast<int>(from.number<std::uint32_t>());
  camera.width = static_cast<int>(from.number<std::uint32_t>());
  const std::string model(from.text());
  const auto num = from.number<std::uint32_t>();
  if (!from.is_good() || num > 64) return damaged_info();
  std::vector<double> d;
  for (std::uint32_t i = 0; i < num; ++i) d.push_back(from.number<double>());
  const auto read_numbers = [&](std::size_t count) {
    std::vector<double> numbers(count);
    for (double& number : numbers) number = from.number<double>();
    return numbers;
  };
  const auto k = read_numbers(9), r = read_numbers(9), p = read_numbers(12);
  if (!from.is_good()) return damaged_info();
  camera.raw = {k[0], k[4], k[2], k[5]};
  camera.rectified = {p[0], p[5], p[2], p[6]};
  for (int i = 0; i < 2; ++i) from.number<std::uint32_t>();  // binning shows in the image's size
  const auto roi_x = from.number<std::uint32_t>(), roi_y = from.number<std::uint32_t>();
  const auto roi_height = from.number<std::uint32_t>(), roi_width = from.number<std::uint32_t>();
  const auto is_inside = [](std::uint32_t first, std::uint32_t length, int of) {
    return std::uint64_t{first} + length <= static_cast<std::uint64_t>(std::max(of, 0));
  };
  // A region beyond that size is ignored: its sender means an image of that size.
  if (is_inside(roi_x, roi_width, camera.width) && is_inside(roi_y, roi_height, camera.height)) {
    camera.roi = {static_cast<int>(roi_x), static_cast<int>(roi_y), static_cast<int>(roi_width),
                  static_cast<int>(roi_height)};
  }
  const bool is_bent = std::any_of(d.begin(), d.end(), [](double c) { return c != 0; });
  if (!is_bent && !is_fisheye(model)) return camera;
  const bool is_known = model == "plumb_bob" || model == "rational_polynomial";
  const bool is_long =
      d.size() > 8 && std::any_of(d.begin() + 8, d.end(), [](double c) { return c != 0; });
  const bool is_whole = d.size() == 4 || d.size() == 5 || d.size() >= 8;
  if (!is_known || is_long || !is_whole) {
    camera.unknown_lens =
        "a camera_info has the distortion model '" + model.substr(0, 40) + "' with " +
        std::to_string(d.size()) +
        " coefficients; known are plumb_bob with 4 or 5 and rational_polynomial with 8; record "
        "undistorted images";
    return camera;
  }
  d.resize(8);
  camera.distortion = {d[0], d[1], d[2], d[3], d[4], d[5], d[6], d[7]};
  if (const Status status = check_distortion(camera.distortion); !status) {
    camera.unknown_lens = "a camera_info is damaged: " + status.error().message;
  }
  return camera;
}

Status check_ros_camera(const RosCameraModel& camera, const std::string& topic) {
  if (is_rectified(camera, topic)) return Done{};
  if (!camera.unknown_lens.empty()) return Error{Errc::bad_input, camera.unknown_lens};
  if (is_positive(camera.raw)) return Done{};
  return Error{Errc::bad_input,
               "a camera_info without intrinsics, as of a camera that is not calibrated; "
               "calibrate it"};
}

void set_ros_camera(const RosCameraModel& camera, const std::string& topic, DepthStreamInfo& info) {
  const bool has_no_lens = is_rectified(camera, topic);
  info.intrinsics = has_no_lens ? camera.rectified : camera.raw;
  info.distortion = has_no_lens ? Distortion{} : camera.distortion;
  const auto& roi = camera.roi;
  ImageSize shown{camera.width, camera.height};
  const bool is_whole = shown == ImageSize{info.width, info.height};
  if (!is_whole && roi.width > 0 && roi.height > 0) {
    info.intrinsics.cx -= roi.x;
    info.intrinsics.cy -= roi.y;
    shown = {roi.width, roi.height};
  }
  scale_camera(shown, info);
}

}}  // namespace palpate::v0
