// Folders of images and simulated scenes.
#include "palpate/io/formats.h"
#include "scenes/scene.h"
#include "src/cameras/camera_kinds.h"
#include "src/cameras/messages/cloud_messages.h"
#include "src/cameras/messages/depth_messages.h"
#include "src/cameras/stream/posed_source.h"
#include "src/io/internal/cloud_folder.h"
#include "src/io/internal/text_scanner.h"

namespace palpate { inline namespace v0 {
namespace {

Result<RawStream> open_clouds(const CameraUri& uri, const FrameList& list) {
  const auto options = cloud_options(uri);
  if (!options) return options.error();
  const auto scale = scale_of_numbers(uri);
  if (!scale) return scale.error();
  auto folder = open_cloud_folder(list, *options, *scale, uri.target);
  if (!folder) return folder.error();
  return RawStream{std::move(folder->images), StampClock::cameras, true, folder->X_FC};
}

}  // namespace

Result<RawStream> open_folder_camera(const CameraUri& uri, const CameraOpening&) {
  if (const Status status = uri.check_extras({"flow", "viewpoint", "look", "scale"}); !status)
    return status.error();
  DepthFolderOptions folder;
  folder.rate = uri.rate.value_or(folder.rate);
  const auto list = list_frames(uri.target, folder.rate);
  if (!list) return list.error();
  if (is_cloud_name(list->entries.front().path)) return open_clouds(uri, *list);
  if (!uri.intrinsics) {
    return Error{
        Errc::invalid_argument,
        "camera " + uri.text +
            ": a folder of images has no intrinsics; pass ?intrinsics=fx,fy,cx,cy in pixels"};
  }
  if (const Status status = check_for_images(uri); !status) return status.error();
  if (uri.extras.contains("scale")) {
    return Error{Errc::invalid_argument, "camera " + uri.text +
                                             ": leave out 'scale': it is of point clouds, and PNGs "
                                             "are counts: pass ?unit=METERS"};
  }
  folder.intrinsics = *uri.intrinsics;
  folder.unit = uri.unit.value_or(folder.unit);
  if (const auto flow = uri.extras.find("flow"); flow != uri.extras.end()) {
    folder.flow = flow->second;
    if (folder.flow.empty()) {
      return Error{Errc::invalid_argument,
                   "camera " + uri.text + ": 'flow' must be a folder of optical flow, not ''"};
    }
  }
  auto source = open_depth_folder(uri.target, *list, folder);
  if (!source) return source.error();
  return RawStream{*std::move(source)};
}

FoundCameras find_folder_cameras() {
  return always_there(
      "16-bit PNGs in name order or by a depth.txt, with ?intrinsics=; or PCD or PLY clouds");
}

Result<RawStream> open_scene_camera(const CameraUri& uri, const CameraOpening& opening) {
  if (const Status status = uri.check_extras({"noise", "seed"}); !status) return status.error();
  auto scene = scenes::make_scene(uri.target);
  if (!scene) return scene.error();
  if (uri.size) scenes::set_image_size(*scene, uri.size->width, uri.size->height);
  if (uri.rate) scene->rate = *uri.rate;
  auto poses = CameraPoses::of(uri);
  if (!poses) return poses.error();
  scene->is_camera_moving = poses->is_moving();
  if (!poses->is_left_alone()) {
    // Frames without a pose are dropped.
    scene->X_WC = [poses = *std::move(poses)](double time) {
      const auto X_WC = poses.at(time);
      return X_WC ? *X_WC : Pose{};
    };
  }
  scenes::SimulatedCameraOptions camera;
  const auto extra = [&](const char* name) {
    const auto found = uri.extras.find(name);
    return found == uri.extras.end() ? std::string() : found->second;
  };
  if (const std::string noise = extra("noise"); noise == "off") {
    camera.noise.enabled = false;
  } else if (!noise.empty() && noise != "on") {
    return Error{Errc::invalid_argument, "camera " + uri.text + ": 'noise' must be on or off"};
  }
  if (const std::string seed = extra("seed"); !seed.empty()) {
    const auto number = parse_number<std::uint64_t>(seed);
    if (!number) {
      return Error{Errc::invalid_argument,
                   "camera " + uri.text + ": 'seed' must be a whole number below 2^64"};
    }
    camera.seed = *number;
  }
  camera.unit = uri.unit.value_or(camera.noise.enabled ? 0.001 : 0.0001);
  camera.duration = opening.duration;
  auto source = scenes::open_simulated_camera(*std::move(scene), camera);
  if (!source) return source.error();
  return RawStream{*std::move(source)};
}

FoundCameras find_scene_cameras() {
  FoundCameras found = always_there("a simulated depth camera; ?noise=off, ?seed=N");
  for (const std::string& name : scenes::scene_names()) found.devices.push_back("scene:" + name);
  return found;
}

}}  // namespace palpate::v0
