#include "palpate/cameras/cameras.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <mutex>
#include <numbers>

#include "src/cameras/camera_kinds.h"
#include "src/cameras/stream/posed_source.h"
#include "src/core/internal/all_at_once.h"

namespace palpate { inline namespace v0 {
namespace {

struct Kind {
  std::string_view name, usage;
  OpenKind& open;
  FindKind& find;
};

constexpr Kind kKinds[] = {
    {"scene", "scene:NAME", open_scene_camera, find_scene_cameras},
    {"folder", "folder:DIR", open_folder_camera, find_folder_cameras},
    {"bag", "bag:FILE.mcap|FILE.bag|FILE.db3|FOLDER[?topic=/T&info=/T&world=FRAME]",
     open_bag_camera, find_bag_cameras},
    {"openni2", "openni2[:NAME|FILE.oni]", open_openni2_camera, find_openni2_cameras},
    {"realsense", "realsense[:SERIAL|FILE.db3|FILE.bag]", open_realsense_camera,
     find_realsense_cameras},
    {"k4a", "k4a[:NUMBER|FILE.mkv]", open_k4a_camera, find_k4a_cameras},
    {"freenect", "freenect[:NUMBER]", open_freenect_camera, find_freenect_cameras},
    {"orbbec", "orbbec[:SERIAL]", open_orbbec_camera, find_orbbec_cameras},
    {"v4l2", "v4l2[:/dev/videoN]?intrinsics=", open_v4l2_camera, find_v4l2_cameras},
    {"ros2", "ros2:/TOPIC[?info=/TOPIC&qos=reliable]", open_ros2_camera, find_ros2_cameras},
    {"pipe", "pipe:[FILE|-]", open_pipe_camera, find_pipe_cameras},
};

/// libk4a logs to the standard output, which may be JSON. Before any thread of ours.
void keep_libraries_quiet() {
  static std::once_flag once;
  std::call_once(once, [] { setenv("K4A_ENABLE_LOG_TO_STDOUT", "0", 0); });
}

Error no_such_kind(const CameraUri& uri) {
  std::string known;
  for (const Kind& kind : kKinds) known += (known.empty() ? "" : ", ") + std::string(kind.usage);
  return {Errc::invalid_argument,
          "no kind of camera is called '" + uri.kind.substr(0, 40) + "'; give one of " + known};
}

Error unused(const CameraUri& uri, const char* parameter, const std::string& why) {
  return {Errc::invalid_argument,
          "camera " + uri.text.substr(0, 60) + ": leave out '" + parameter + "': " + why};
}

/// Refuses parameters that the kind does not know.
Status check_unused(const Kind& kind, const CameraUri& uri) {
  const bool is_played = uri.target.ends_with(".oni") || kind.name == "k4a";
  if (uri.size && is_played) {
    return unused(uri, "size",
                  "the images of " + std::string(kind.name) + " say their size themselves");
  }
  if (uri.extras.contains("frame") && !uri.extras.contains("world")) {
    return unused(uri, "frame", "it goes with 'world', the tf frame that the camera is placed in");
  }
  return Done{};
}

Result<std::unique_ptr<DepthSource>> open_unposed(const Kind& kind, const CameraUri& uri,
                                                  const CameraOpening& opening,
                                                  std::optional<Pose>& X_FC) {
  if (const Status status = check_unused(kind, uri); !status) return status.error();
  auto raw = kind.open(uri, opening);
  if (!raw) return raw.error();
  X_FC = raw->X_FC;
  if (!raw->source->info().is_live) {
    if (uri.latency != 0 && kind.name != "bag") {
      return unused(uri, "latency", "it is of live cameras, and of bag");
    }
    return make_rectified(*std::move(raw), uri);
  }
  OpenRaw again;
  if (raw->can_come_back) {
    again = [open = &kind.open, uri, opening] { return open(uri, opening); };
  }
  return make_live(*std::move(raw), std::move(again), uri);
}

}  // namespace

std::vector<FoundCameras> find_cameras() {
  keep_libraries_quiet();
  constexpr double kPatience = 30;  // s
  auto all = find_all_at_once(kKinds, kPatience, [](const Kind&) {
    FoundCameras found;
    found.reason = "its driver has not returned for 30 s; unplug its cameras and try again";
    return found;
  });
  for (std::size_t i = 0; i < all.size(); ++i) {
    all[i].kind = kKinds[i].name;
    all[i].usage = kKinds[i].usage;
  }
  return all;
}

Result<std::optional<Pose>> standing_pose(const CameraUri& uri) {
  RobotTrees trees;
  return standing_pose(uri, trees);
}

std::optional<Vec3d> gravity_seen(std::span<const CameraUri> cameras) {
  RobotTrees trees;
  for (const CameraUri& camera : cameras) {
    if (!camera.accelerometer) continue;
    const auto X_WC = standing_pose(camera, trees);
    // At rest it is held against gravity.
    if (X_WC && *X_WC) return -rotate((*X_WC)->rotation, *camera.accelerometer);
  }
  return std::nullopt;
}

std::vector<std::string> gravity_doubts(std::span<const CameraUri> cameras, const Vec3d& gravity) {
  constexpr double kMaxAngle = 10, kMaxRatio = 1.1;  // degrees
  std::vector<std::string> doubts;
  const double size = norm(gravity);
  for (std::size_t k = 0; k < cameras.size() && size > 0; ++k) {
    const auto seen = gravity_seen(cameras.subspan(k, 1));
    if (!seen) continue;
    const double angle =
        180 / std::numbers::pi * std::atan2(norm(cross(*seen, gravity)), dot(*seen, gravity));
    const double ratio = std::max(norm(*seen) / size, size / norm(*seen));
    if (angle <= kMaxAngle && ratio <= kMaxRatio) continue;
    char text[200];
    std::snprintf(text, sizeof text,
                  ": by its pose and its accelerometer, gravity in the world is %.3g, %.3g, %.3g "
                  "m/s2, %.0f degrees from the %.3g, %.3g, %.3g that are used",
                  seen->x, seen->y, seen->z, angle, gravity.x, gravity.y, gravity.z);
    doubts.push_back(cameras[k].text + text + "; check both, and the gravity that is given");
  }
  return doubts;
}

Result<std::unique_ptr<DepthSource>> open_camera(std::string_view text,
                                                 const CameraOpening& opening) {
  const auto uri = parse_camera_uri(text);
  if (!uri) return uri.error();
  return open_camera(*uri, opening);
}

Result<std::unique_ptr<DepthSource>> open_camera(const CameraUri& uri,
                                                 const CameraOpening& opening) {
  keep_libraries_quiet();
  const auto kind = std::ranges::find(kKinds, std::string_view(uri.kind), &Kind::name);
  if (kind == std::end(kKinds)) return no_such_kind(uri);
  auto poses = CameraPoses::of(uri);
  if (!poses) return poses.error();
  std::optional<Pose> X_FC;
  auto source = open_unposed(*kind, uri, opening, X_FC);
  if (!source) return source.error();
  return make_posed(*std::move(source), *std::move(poses), X_FC);
}

}}  // namespace palpate::v0
