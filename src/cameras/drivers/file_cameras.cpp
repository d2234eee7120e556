// Folders of images and simulated scenes.
#include "palpate/io/formats.h"
#include "scenes/scene.h"
#include "src/cameras/camera_kinds.h"
#include "src/cameras/stream/posed_source.h"
#include "src/io/internal/text_scanner.h"

namespace palpate { inline namespace v0 {

Result<RawStream> open_folder_camera(const CameraUri& uri, const CameraOpening&) {
  if (const Status status = uri.check_extras({"flow"}); !status) return status.error();
  if (!uri.intrinsics) {
    return Error{
        Errc::invalid_argument,
        "camera " + uri.text +
            ": a folder of images has no intrinsics; pass ?intrinsics=fx,fy,cx,cy in pixels"};
  }
  DepthFolderOptions folder;
  folder.intrinsics = *uri.intrinsics;
  folder.unit = uri.unit.value_or(folder.unit);
  folder.rate = uri.rate.value_or(folder.rate);
  if (const auto flow = uri.extras.find("flow"); flow != uri.extras.end()) {
    folder.flow = flow->second;
    if (folder.flow.empty()) {
      return Error{Errc::invalid_argument,
                   "camera " + uri.text + ": 'flow' must be a folder of optical flow, not ''"};
    }
  }
  auto source = open_depth_folder(uri.target, folder);
  if (!source) return source.error();
  return RawStream{*std::move(source)};
}

FoundCameras find_folder_cameras() {
  return {"folder",
          "folder:DIR",
          true,
          "",
          "",
          {},
          "16-bit PNGs in name order or by a depth.txt; with ?intrinsics="};
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
  FoundCameras found{
      "scene", "scene:NAME", true, "", "", {}, "a simulated depth camera; ?noise=off, ?seed=N"};
  for (const std::string& name : scenes::scene_names()) found.devices.push_back("scene:" + name);
  return found;
}

}}  // namespace palpate::v0
