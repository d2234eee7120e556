#include "palpate/cameras/cameras.h"

#include <algorithm>
#include <cmath>
#include <set>
#include <vector>

#include "palpate/cloud/depth_source.h"
#include "palpate/settings/setting_table.h"
#include "src/cloud/internal/frame_limits.h"
#include "src/cloud/internal/lens_table.h"
#include "src/io/internal/text_scanner.h"

namespace palpate { inline namespace v0 {
namespace {

constexpr std::size_t kMaxCharacters = 60;  // characters of the user's text

/// Returns the text before the first `mark`; `rest` keeps the text after it.
std::string_view take_until(std::string_view& rest, char mark) {
  const std::size_t at = rest.find(mark);
  const std::string_view part = rest.substr(0, at);
  rest = at == std::string_view::npos ? std::string_view{} : rest.substr(at + 1);
  return part;
}

/// Finite numbers with commas between them; none: it is not that.
std::vector<double> parse_numbers(std::string_view text) {
  std::vector<double> numbers;
  for (bool is_last = false; !is_last;) {
    is_last = text.find(',') == std::string_view::npos;
    const auto number = parse_number<double>(take_until(text, ','));
    if (!number || !std::isfinite(*number)) return {};
    numbers.push_back(*number);
  }
  return numbers;
}

class Parameters {
 public:
  explicit Parameters(CameraUri& uri) : uri_(uri) {}

  Status set(std::string_view name, std::string_view value) {
    name_ = name;
    value_ = value;
    if (!names_.insert(std::string(name)).second) return bad("given once");
    numbers_ = parse_numbers(value);
    if (name == "intrinsics") return set_intrinsics();
    if (name == "distortion") return set_distortion();
    if (name == "size") return set_size();
    if (name == "unit")
      return set_positive(uri_.unit, 1e-6, kLargestUnit, "meters per count, e.g. 0.001");
    if (name == "rate") return set_positive(uri_.rate, 0.01, 10000, "frames per second");
    if (name == "latency") return set_latency();
    if (name == "pose") return set_pose();
    if (name == "poses") return set_poses();
    if (name == "urdf") return set_urdf();
    if (name == "joints") return set_joints();
    if (name == "accelerometer") return set_accelerometer();
    if (name == "sensor") return set_sensor();
    if (name == "crop") return set_crop();
    uri_.extras[std::string(name)] = value;
    return Done{};
  }

 private:
  Error bad(const std::string& desired) const {
    return {Errc::invalid_argument, "camera " + uri_.text.substr(0, kMaxCharacters) + ": '" +
                                        std::string(name_) + "' must be " + desired + ", not '" +
                                        std::string(value_.substr(0, kMaxCharacters)) + "'"};
  }
  Status set_intrinsics() {
    if (numbers_.size() != 4 || !(numbers_[0] > 0) || !(numbers_[1] > 0)) {
      return bad("fx,fy,cx,cy in pixels, the first two above 0");
    }
    uri_.intrinsics = {numbers_[0], numbers_[1], numbers_[2], numbers_[3]};
    return Done{};
  }
  Status set_distortion() {
    if (numbers_.size() != 4 && numbers_.size() != 5 && numbers_.size() != 8) {
      return bad("k1,k2,p1,p2[,k3[,k4,k5,k6]]");
    }
    numbers_.resize(8);
    const auto& n = numbers_;
    uri_.distortion = {n[0], n[1], n[2], n[3], n[4], n[5], n[6], n[7]};
    return check_distortion(*uri_.distortion) ? Status(Done{})
                                              : bad("coefficients from -1000000 to 1000000");
  }
  Status set_size() {
    std::string_view rest = value_;
    const auto width = parse_number<int>(take_until(rest, 'x')), height = parse_number<int>(rest);
    if (!width || !height || *width < 8 || *height < 8 || *width > kMaxImageWidth ||
        *height > kMaxImageHeight) {
      return bad("WIDTHxHEIGHT from 8x8 to 4096x4096");
    }
    uri_.size = {*width, *height};
    return Done{};
  }
  Status set_positive(std::optional<double>& to, double low, double high, const char* desired) {
    if (numbers_.size() != 1 || numbers_[0] < low || numbers_[0] > high) return bad(desired);
    to = numbers_[0];
    return Done{};
  }
  Status set_latency() {
    std::optional<double> latency;
    if (const Status status = set_positive(latency, 0, 1, "seconds from 0 to 1"); !status) {
      return status;
    }
    uri_.latency = *latency;
    return Done{};
  }
  Status set_pose() {
    const auto& n = numbers_;
    if (n.size() != 7) return bad("tx,ty,tz,qx,qy,qz,qw");
    const double length = std::sqrt(n[3] * n[3] + n[4] * n[4] + n[5] * n[5] + n[6] * n[6]);
    if (!(std::abs(length - 1) < 0.01)) return bad("tx,ty,tz,qx,qy,qz,qw with a quaternion 1 long");
    uri_.X_WC = {{n[0], n[1], n[2]}, normalized(Quaternion{n[3], n[4], n[5], n[6]})};
    return Done{};
  }

  Status set_poses() {
    uri_.poses = value_;
    return value_.empty() ? Status(bad("a file of lines 't tx ty tz qx qy qz qw'")) : Done{};
  }

  Status set_urdf() {
    uri_.urdf = value_;
    return value_.find('#') == std::string_view::npos ? Status(bad("FILE.urdf#LINK")) : Done{};
  }

  Status set_joints() {
    uri_.joints = value_;
    return value_.empty() ? Status(bad("FILE.csv, bag:FILE or ros2:[/T]")) : Done{};
  }

  Status set_accelerometer() {
    const auto& n = numbers_;
    if (n.size() != 3) return bad("ax,ay,az in m/s2, as it reads where the camera rests");
    uri_.accelerometer = Vec3d{n[0], n[1], n[2]};
    const double length = norm(*uri_.accelerometer);
    if (!(length > 8 && length < 12)) return bad("about 9.81 m/s2 long, of a camera at rest");
    return Done{};
  }

  Status set_sensor() {
    uri_.sensor = value_named<SensorKind>(value_);
    return uri_.sensor ? Status(Done{})
                       : bad("one of none, structured_light, active_stereo and tof");
  }

  Status set_crop() {
    uri_.is_cropped = value_ == "valid";
    return uri_.is_cropped || value_ == "none" ? Status(Done{}) : bad("none or valid");
  }

  CameraUri& uri_;
  std::set<std::string> names_;
  std::string_view name_, value_;
  std::vector<double> numbers_;
};

}  // namespace

Result<CameraUri> parse_camera_uri(std::string_view text) {
  CameraUri uri;
  uri.text = text;
  std::string_view rest = text;
  std::string_view address = take_until(rest, '?');
  uri.kind = take_until(address, ':');
  uri.target = address;
  Parameters parameters(uri);
  while (!rest.empty()) {
    std::string_view value = take_until(rest, '&');
    const bool has_value = value.find('=') != std::string_view::npos;
    const std::string_view name = take_until(value, '=');
    if (!has_value || name.empty()) {
      return Error{Errc::invalid_argument,
                   "camera " + uri.text.substr(0, kMaxCharacters) +
                       ": what follows '?' must be NAME=VALUE, with '&' between them"};
    }
    if (const Status status = parameters.set(name, value); !status) return status.error();
  }
  return uri;
}

Result<std::vector<CameraUri>> parse_camera_uris(std::span<const std::string> texts) {
  std::vector<CameraUri> cameras;
  for (const std::string& text : texts) {
    auto parsed = parse_camera_uri(text);
    if (!parsed) return parsed.error();
    const auto look = parsed->extras.find("look");
    if (look == parsed->extras.end() || look->second != "round") {
      cameras.push_back(*std::move(parsed));
      continue;
    }
    for (const char* const way : {"1,0,0", "0,1,0", "-1,0,0", "0,-1,0"}) {
      look->second = way;
      parsed->text = text;
      const std::size_t at = std::min(text.find("?look=round"), text.find("&look=round")) + 1;
      parsed->text.replace(at, std::string_view("look=round").size(), std::string("look=") + way);
      cameras.push_back(*parsed);
    }
  }
  return cameras;
}

Status check_one_world(std::span<const CameraUri> cameras) {
  const std::string* world = nullptr;
  for (const CameraUri& camera : cameras) {
    const auto given = camera.extras.find("world");
    if (given == camera.extras.end()) continue;
    if (world == nullptr) world = &given->second;
    if (given->second == *world) continue;
    return Error{Errc::invalid_argument, "cameras are placed in different worlds, '" + *world +
                                             "' and '" + given->second +
                                             "': give all of them the same world=FRAME"};
  }
  return Done{};
}

Status CameraUri::check_extras(std::initializer_list<std::string_view> known_ones) const {
  for (const auto& [name, value] : extras) {
    if (std::ranges::find(known_ones, name) != known_ones.end()) continue;
    std::string known =
        "intrinsics, distortion, size, unit, rate, latency, pose, poses, urdf, joints, "
        "accelerometer, sensor, crop";
    for (const std::string_view more : known_ones) known += ", " + std::string(more);
    return Error{Errc::invalid_argument,
                 "camera " + text.substr(0, kMaxCharacters) + ": there is no parameter '" +
                     name.substr(0, kMaxCharacters) + "' of " + kind + "; there are " + known};
  }
  return Done{};
}

}}  // namespace palpate::v0
