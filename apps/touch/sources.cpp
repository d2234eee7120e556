#include "apps/touch/sources.h"

#include <algorithm>
#include <string>
#include <tuple>

#include "apps/terminal/terminal.h"
#include "palpate/field/sensor.h"
#include "scenes/scene.h"
#include "src/settings/internal/did_you_mean.h"

namespace palpate::apps {
namespace {

std::string scene_names() {
  std::string names;
  for (const std::string& name : scenes::scene_names()) names += (names.empty() ? "" : ", ") + name;
  return names;
}

CameraUri camera_of_sequence(const SourceOptions& options) {
  CameraUri uri;
  uri.kind = "folder";
  uri.target = options.depth_sequence;
  uri.text = "folder:" + uri.target;
  uri.intrinsics = options.camera.intrinsics;
  uri.unit = options.camera.unit;
  uri.rate = options.rate;
  return uri;
}

CameraUri camera_of_scene(const SourceOptions& options) {
  CameraUri uri;
  uri.kind = "scene";
  uri.target = options.scene;
  uri.text = "scene:" + uri.target;
  uri.extras["noise"] = options.noise ? "on" : "off";
  uri.extras["seed"] = std::to_string(options.seed);
  return uri;
}

}  // namespace

void warn_of_twins(std::span<const CameraUri> cameras) {
  const auto place = [](const CameraUri& a) {
    return std::tie(a.kind, a.target, a.extras, a.poses, a.urdf);
  };
  for (std::size_t k = 1; k < cameras.size(); ++k) {
    const bool has_twin = std::ranges::any_of(cameras.first(k), [&](const CameraUri& other) {
      return place(other) == place(cameras[k]) && other.X_WC == cameras[k].X_WC;
    });
    if (!has_twin) continue;
    print_warning("--camera " + cameras[k].text +
                  " is given twice, at the same pose: give each camera its own ?pose=");
    return;
  }
}

void add_source_options(CLI::App& app, SourceOptions& options) {
  app.add_option("--camera", options.cameras,
                 "depth stream, KIND[:TARGET][?NAME=VALUE&...], e.g. "
                 "'folder:frames/?intrinsics=525,525,319.5,239.5'; or "
                 "'pipe:-?size=640x480&intrinsics=...'; palpate cameras lists the kinds; repeat "
                 "for several, each with its &pose=tx,ty,tz,qx,qy,qz,qw in the world; default: "
                 "the camera that is plugged in")
      ->type_name("URI");
  app.add_option("--rig", options.rig,
                 "rig file with several cameras: [[camera]] with uri and pose")
      ->type_name("RIG.toml");
  app.add_option("--depth-sequence", options.depth_sequence,
                 "folder of 16-bit PNGs, with timestamps in depth.txt or in name order")
      ->type_name("DIR");
  add_camera_options(app, options.camera);
  add_number(app, "--depth-rate", options.rate, {0.01, 10000, "Hz"},
             "frames per second, if there are no timestamps");
  app.add_option("--scene", options.scene,
                 "simulated camera, e.g. hand; palpate scenes lists them: " + scene_names())
      ->type_name("NAME");
  app.add_flag_callback(
      "--no-noise", [&options] { options.noise = false; }, "simulated camera without noise");
  add_seed_option(app, options.seed, "of the simulated noise");
  add_sensor_option(app, options.sensor);
}

namespace {

std::vector<CameraUri> named_cameras(const SourceOptions& options, const std::string& verb) {
  const auto refuse = [&](const std::string& why) { usage_error(verb + ": " + why); };
  const int num_sources = int(!options.depth_sequence.empty()) + int(!options.scene.empty()) +
                          int(!options.cameras.empty()) + int(!options.rig.empty());
  if (num_sources > 1) refuse("give one of --camera, --rig, --depth-sequence and --scene");
  if (options.depth_sequence.empty() && options.camera.intrinsics) {
    refuse("--intrinsics goes with --depth-sequence; a camera takes ?intrinsics=");
  }
  if (options.depth_sequence.empty() && options.camera.unit != CameraOptions().unit) {
    refuse("--depth-unit goes with --depth-sequence; a camera takes ?unit=");
  }
  if (options.depth_sequence.empty() && options.rate != SourceOptions().rate) {
    refuse("--depth-rate goes with --depth-sequence; a camera takes ?rate=");
  }
  if (options.scene.empty() && !options.noise) refuse("--no-noise goes with --scene");
  if (options.scene.empty() && options.seed != SourceOptions().seed) {
    refuse("--seed goes with --scene; a camera takes ?seed=");
  }
  if (!options.depth_sequence.empty()) {
    if (!options.camera.intrinsics) refuse("--depth-sequence needs --intrinsics fx,fy,cx,cy");
    return {camera_of_sequence(options)};
  }
  if (!options.scene.empty()) {
    const auto known = scenes::scene_names();
    if (std::ranges::find(known, options.scene) == known.end()) {
      const std::string hint = did_you_mean(options.scene, known);
      refuse("there is no scene '" + options.scene + "'" +
             (hint.empty() ? "; choose one of " + scene_names() : hint));
    }
    return {camera_of_scene(options)};
  }
  auto cameras = parse_camera_uris(options.cameras);
  if (!cameras) usage_error("--" + cameras.error().message);
  if (cameras->size() > kMaxCameras) {
    refuse("at most " + std::to_string(kMaxCameras) + " cameras are joined");
  }
  return *std::move(cameras);
}

}  // namespace

std::vector<CameraUri> cameras_of(const SourceOptions& options, const std::string& verb) {
  std::vector<CameraUri> cameras = named_cameras(options, verb);
  for (CameraUri& uri : cameras) {
    use_sensor(options.sensor, uri);
  }
  return cameras;
}

CameraOpening opening(bool in_real_time, std::optional<double> duration) {
  return {in_real_time, duration, print_note};
}

}  // namespace palpate::apps
