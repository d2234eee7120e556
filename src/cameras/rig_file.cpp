#include "palpate/cameras/cameras.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <fstream>
#include <set>
#include <span>
#include <sstream>
#include <utility>

#include "palpate/field/sensor.h"
#include "palpate/settings/setting_table.h"
#include "src/cameras/stream/posed_source.h"
#include "src/io/internal/toml_file.h"

namespace palpate { inline namespace v0 {
namespace {

namespace fs = std::filesystem;

constexpr std::array<std::string_view, 10> kCameraKeys{
    "name", "uri",       "intrinsics", "distortion", "unit",
    "pose", "pose_from", "joints",     "latency",    "accelerometer"};
constexpr std::string_view kUrdf = "urdf:";

/// "1,2,3" as the words of a URI have it; empty: these are no numbers.
std::string numbers_text(const toml::node& node) {
  std::string text;
  const auto add = [&](const toml::node& number) {
    if (!number.is_number()) return false;
    text += (text.empty() ? "" : ",") + shortest_decimal(number_of(number));
    return true;
  };
  if (const toml::array* const array = node.as_array()) {
    for (const toml::node& number : *array) {
      if (!add(number)) return {};
    }
    return text;
  }
  return add(node) ? text : std::string();
}

class Reader {
 public:
  explicit Reader(const fs::path& path) : path_(path) {}

  Result<CameraRig> read(const toml::table& document) {
    // Cameras name the world's frame.
    if (const toml::table* const world = document["world"].as_table()) {
      if (const Status status = read_world(*world); !status) return status.error();
    }
    for (const auto& [key, node] : document) {
      Status status = Done{};
      if (key == "world" && node.is_table()) continue;
      if (key == "camera" && node.is_array_of_tables()) {
        status = read_cameras(*node.as_array());
      } else if (key == "frames" && node.is_table()) {
        status = read_frames(*node.as_table());
      } else {
        status =
            refuse(key.source(), "'" + std::string(key.str()) +
                                     "' is not known: a rig has [world], [frames] and [[camera]]");
      }
      if (!status) return status.error();
    }
    const std::size_t num = rig_.cameras.size();
    if (num == 0 || num > kMaxCameras) {
      return Error{Errc::bad_input, path_.string() + " has " + std::to_string(num) +
                                        " [[camera]]; give 1 to " + std::to_string(kMaxCameras)};
    }
    if (!rig_.gravity) {
      std::vector<CameraUri> uris;
      for (const CameraRig::Camera& camera : rig_.cameras) uris.push_back(camera.uri);
      rig_.gravity = gravity_seen(uris);
    }
    return std::move(rig_);
  }

 private:
  /// Seven numbers, or the link of a URDF: as of a camera there.
  Status read_frames(const toml::table& frames) {
    for (const auto& [key, node] : frames) {
      const std::string from = node.value_or(std::string());
      const bool is_link = from.starts_with(kUrdf) && from.find('#') != from.npos;
      auto uri = parse_camera_uri(is_link ? "frame" : "frame?pose=" + numbers_text(node));
      if (is_link) uri->urdf = link_in_world(from);
      if (!uri) {
        return refuse(key.source(), "[frames] " + std::string(key.str()) +
                                        " must be [tx, ty, tz, qx, qy, qz, qw] or "
                                        "\"urdf:FILE.urdf#LINK\"");
      }
      const auto X_WF = standing_pose(*uri, trees_);
      if (!X_WF) return refuse(key.source(), X_WF.error().message);
      rig_.frames[std::string(key.str())] = **X_WF;
    }
    return Done{};
  }

  Status read_world(const toml::table& world) {
    for (const auto& [key, node] : world) {
      const std::string numbers = numbers_text(node);
      if (key == "frame" && node.is_string()) {
        rig_.frame = **node.as_string();
        names_world_ = true;
      } else if (key == "gravity" && std::ranges::count(numbers, ',') == 2) {
        Vec3d& g = rig_.gravity.emplace();
        std::sscanf(numbers.c_str(), "%lf,%lf,%lf", &g.x, &g.y, &g.z);
        constexpr double kLargest = 100;  // m/s2, as bodies.gravity_x
        if (!(std::abs(g.x) <= kLargest && std::abs(g.y) <= kLargest &&
              std::abs(g.z) <= kLargest)) {
          return refuse(key.source(), "gravity must be numbers from -100 to 100 m/s2");
        }
      } else {
        return refuse(key.source(), "[world] has frame = \"NAME\" and gravity = [x, y, z], not '" +
                                        std::string(key.str()) + "' like this");
      }
    }
    return Done{};
  }

  Status read_cameras(const toml::array& cameras) {
    for (const toml::node& node : cameras) {
      if (const Status status = read_camera(*node.as_table()); !status) return status.error();
    }
    return Done{};
  }

  /// Numbers become words of a URI, which says what is wrong with them. Names of files do not: they
  /// may have '&' in them.
  Status read_camera(const toml::table& table) {
    const std::string number = std::to_string(rig_.cameras.size() + 1);
    const auto text_of = [&](const char* key) { return table[key].value_or(std::string()); };
    const std::string name = table.contains("name") ? text_of("name") : "camera " + number;
    std::string uri = text_of("uri"), more;
    CameraUri files;
    if (name.empty()) {
      return refuse(table.source(), "camera " + number + " needs a name = \"NAME\", or none");
    }
    if (uri.empty()) {
      return refuse(table.source(), "camera " + number + " needs uri = \"KIND:TARGET\"");
    }
    for (const auto& [key, node] : table) {
      const std::string_view word = key.str();
      if (word == "name" || word == "uri") continue;
      if (std::ranges::find(kCameraKeys, word) == kCameraKeys.end()) {
        return refuse(key.source(),
                      "[[camera]] has no key '" + std::string(word) + "'; the nearest one is '" +
                          nearest_word(word, std::vector<std::string>(kCameraKeys.begin(),
                                                                      kCameraKeys.end())) +
                          "'");
      }
      if (word == "pose_from") {
        const std::string from = text_of("pose_from");
        const bool is_urdf = from.starts_with(kUrdf);
        if (from.empty() || (is_urdf && from.find('#') == from.npos)) {
          return refuse(node.source(), "camera " + name +
                                           ": pose_from must be \"FILE\" of lines 't tx ty tz qx "
                                           "qy qz qw', \"urdf:FILE.urdf#LINK\" or \"tf:FRAME\"");
        }
        if (from.starts_with("tf:")) {
          more += "&world=" + rig_.frame + "&frame=" + from.substr(3);
        } else if (is_urdf) {
          files.urdf = link_in_world(from);
        } else {
          files.poses = beside(from);
        }
        continue;
      }
      if (word == "joints") {
        constexpr std::string_view kBag = "bag:";
        const std::string from = text_of("joints");
        if (from.empty()) {
          return refuse(node.source(), "camera " + name +
                                           ": joints must be \"FILE.csv\", \"bag:FILE\" or "
                                           "\"ros2:[/T]\"");
        }
        files.joints = from.starts_with("ros2:") ? from
                       : from.starts_with(kBag)  ? "bag:" + beside(from.substr(kBag.size()))
                                                 : beside(from);
        continue;
      }
      const std::string numbers = numbers_text(node);
      if (numbers.empty()) {
        return refuse(node.source(), "camera " + name + ": " + std::string(word) +
                                         " must be a number or a list of numbers");
      }
      more += "&" + std::string(word) + "=" + numbers;
    }
    if (!more.empty() && uri.find('?') == std::string::npos) more.front() = '?';
    if (uri.ends_with('?') || uri.ends_with('&')) more.erase(0, 1);
    auto parsed = parse_camera_uri(uri + more);
    if (!parsed) return refuse(table.source(), parsed.error().message);
    for (std::string CameraUri::*const file :
         {&CameraUri::poses, &CameraUri::urdf, &CameraUri::joints}) {
      if ((files.*file).empty()) continue;
      if (!((*parsed).*file).empty()) {
        return refuse(table.source(), "camera " + name + ": '" + (files.*file) +
                                          "' must be given once: here or in its uri");
      }
      (*parsed).*file = files.*file;
    }
    std::error_code ignored;  // a name may be too long for a file
    const bool is_file = parsed->kind == "folder" || fs::exists(beside(parsed->target), ignored);
    if (is_file) parsed->target = beside(parsed->target);
    if (!names_.insert(name).second) {
      return refuse(table.source(), "two cameras are called '" + name + "'");
    }
    rig_.cameras.push_back({name, *std::move(parsed)});
    return Done{};
  }

  /// "urdf:FILE#LINK" as a URI has it, in the link that W is called like, if people say how.
  std::string link_in_world(const std::string& from) const {
    const std::string address = beside(from.substr(kUrdf.size()));
    const bool has_base = end_of_file(address) != address.rfind('#');
    return has_base || !names_world_ ? address : address + "#" + rig_.frame;
  }
  std::string beside(const std::string& file) const {
    return file.empty() ? file : (path_.parent_path() / file).string();
  }
  Error refuse(const toml::source_region& where, const std::string& what) const {
    return {Errc::bad_input,
            path_.string() + " line " + std::to_string(where.begin.line) + ": " + what};
  }

  fs::path path_;
  CameraRig rig_;
  RobotTrees trees_;
  bool names_world_ = false;
  std::set<std::string> names_;
};

/// Takes the pose out of a URI: a rig has it once, here or there.
std::string without_pose(std::string uri) {
  for (std::size_t at = uri.find('?'); at != uri.npos; at = uri.find('&', at + 1)) {
    const std::size_t begin = at + 1;
    if (uri.compare(begin, 5, "pose=") != 0) continue;
    const std::size_t end = std::min(uri.find('&', begin), uri.size());
    return uri.erase(end < uri.size() ? begin : at, end - begin + 1);
  }
  return uri;
}

}  // namespace

Result<CameraRig> load_rig(const fs::path& path) {
  const auto document = read_toml(path);
  if (!document) return document.error();
  return Reader(path).read(*document);
}

Result<std::string> rig_text_with_poses(const fs::path& path, const std::vector<Pose>& X_WC) {
  auto document = read_toml(path);
  if (!document) return document.error();
  const auto rig = load_rig(path);
  if (!rig) return rig.error();
  toml::array* const cameras = (*document)["camera"].as_array();
  if (cameras == nullptr || cameras->size() != X_WC.size()) {
    return Error{Errc::bad_input, path.string() + " has changed meanwhile"};
  }
  RobotTrees trees;
  for (std::size_t i = 0; i < X_WC.size(); ++i) {
    CameraUri unposed = rig->cameras[i].uri;
    unposed.X_WC = {};
    const auto X_WH = standing_pose(unposed, trees);
    if (!X_WH) return X_WH.error();
    const auto [p, q] = inverse(X_WH->value_or(Pose{})) * X_WC[i];
    toml::table& camera = *(*cameras)[i].as_table();
    camera.insert_or_assign("uri", without_pose(camera["uri"].value_or(std::string())));
    camera.insert_or_assign("pose", toml::array{p.x, p.y, p.z, q.x, q.y, q.z, q.w});
  }
  std::ostringstream text;
  text << *document << "\n";
  return text.str();
}

}}  // namespace palpate::v0
