// Inputs of palpate touch: depth frames, a path, and the alignment of their clocks.
#include <algorithm>
#include <cmath>
#include <iostream>
#include <utility>

#include "apps/terminal/terminal.h"
#include "apps/touch/held_frames.h"
#include "apps/touch/sources.h"
#include "apps/touch/touch.h"
#include "palpate/cameras/cameras.h"
#include "scenes/scene.h"

namespace palpate::apps {
namespace {

/// True if a time, s, counts from 1970: a clock that begins with a run never gets to 1e8.
bool counts_from_1970(double time) { return time > 1e8; }

bool is_aimed(const ProbeAim& aim) { return aim.pixel || aim.point_W || aim.tip_T; }

/// Opens the frames that a user requests. `duration`: of simulated ones, nullopt for the scene's.
/// `X_FC`: set for clouds that are projected.
Result<std::unique_ptr<DepthSource>> open_stream(const TouchOptions& options,
                                                 const CameraUri& camera,
                                                 std::optional<double> duration,
                                                 std::optional<Pose>* X_FC = nullptr) {
  auto source = open_camera(camera, opening(!options.device.empty(), duration));
  if (!source) return source;
  if (X_FC != nullptr) *X_FC = projection_of(**source);
  return without_robot(options.self_filter, *std::move(source),
                       place_of_surfaces(options.settings));
}

/// Returns the camera for which paths are generated.
const CameraUri& first_camera(const TouchOptions& options) { return options.cameras.front(); }

/// True if the stream cannot be opened again from its first frame: cameras and pipes.
bool comes_once(const TouchOptions& options, const DepthStreamInfo& stream) {
  return stream.is_live || first_camera(options).kind == "pipe";
}

/// Returns the first frame, with camera pose and time stamp. Error: there is none.
Result<DepthFrame> first_frame(const OpenDepthSource& open) {
  const auto source = open();
  if (!source) return source.error();
  DepthFrame frame;
  const auto got = (*source)->next(frame);
  if (!got) return got.error();
  if (!*got) return Error{Errc::bad_input, (*source)->info().name + " has no frames"};
  return frame;
}

/// Generates the path, in the frame of the first camera, which must be static.
Status add_probing_path(const TouchOptions& options, const Tool& tool, const OpenDepthSource& open,
                        TouchInput& input) {
  if (input.stream().is_moving) {
    return Error{
        Errc::bad_input,
        input.stream().name + " moves: no path is made up for it; give --path, or a --device"};
  }
  const auto first = first_frame(open);
  if (!first) return first.error();
  const Pose& X_WC = first->X_WC;
  ProbeAim aim = options.aim;
  if (aim.point_W) aim.point_W = inverse(X_WC) * *aim.point_W;
  const auto open_in_camera = [&]() -> Result<std::unique_ptr<DepthSource>> {
    auto source = open();
    if (!source) return source.error();
    return std::unique_ptr<DepthSource>(std::make_unique<FramesInCamera>(*std::move(source)));
  };
  auto path = probing_path(open_in_camera, tool, options.duration, aim);
  if (!path) return path.error();
  input.path = std::move(path->poses);
  for (TimedPose& pose : input.path) pose.X_WT = X_WC * pose.X_WT;
  input.probe = std::move(path->choice);
  input.probe->p_W = X_WC * input.probe->p_W;
  input.X_WC = X_WC;
  if (!input.probe->note.empty()) print_note(input.probe->note);
  return Done{};
}

/// Generates the path from the first frames of a stream that cannot be opened again.
Status add_path_at_first_sight(const TouchOptions& options, const Tool& tool, TouchInput& input) {
  constexpr std::size_t kNumLooks = 8;
  std::vector<DepthFrame> seen;
  while (seen.size() < kNumLooks) {
    const auto got = input.sources.front()->next(seen.emplace_back());
    if (!got) return got.error();
    if (!*got) seen.pop_back();
    if (!*got) break;
  }
  const DepthStreamInfo info = input.stream();
  if (seen.empty()) return Error{Errc::bad_input, info.name + " has no frames"};
  TouchOptions short_probe = options;
  short_probe.duration.reset();
  const Status added = add_probing_path(
      short_probe, tool,
      [&]() -> Result<std::unique_ptr<DepthSource>> {
        return std::unique_ptr<DepthSource>(std::make_unique<PreparedFrames>(seen, info));
      },
      input);
  if (added && !info.is_live) {
    auto& first = input.sources.front();
    first = std::make_unique<FramesAgain>(std::move(seen), std::move(first));
  }
  return added;
}

Status add_path_of_scene(const std::string& name, TouchInput& input) {
  const auto scene = scenes::make_scene(name);
  if (!scene) return scene.error();
  for (std::size_t i = 0; i < scene->path_times.size(); ++i) {
    input.path.push_back({scene->path_times[i], scene->path_poses[i]});
  }
  return Done{};
}

/// Returns the name of the simulated scene, which may have a path of its own; else empty.
std::string scene_name(const TouchOptions& options) {
  return first_camera(options).kind == "scene" ? first_camera(options).target : "";
}

/// Reads the given path or that of a replay device; else takes the scene's or generates one.
Status add_path(const TouchOptions& options, const Tool& tool, TouchInput& input) {
  if (options.is_robot()) return Done{};  // it moves the tool
  const std::string given = options.is_replay() ? options.device.substr(7) : options.path;
  if (!given.empty()) {
    auto path = load_trajectory(given);
    if (!path) return path.error();
    input.path = *std::move(path);
    const Pose X_ET = inverse(options.settings.output.X_TE);
    const bool is_as_given = options.is_path_of_handle() ||
                             (options.X_WF == Pose{} && options.settings.output.X_TE == Pose{});
    for (TimedPose& pose : input.path) {
      if (!is_as_given) pose.X_WT = options.X_WF * pose.X_WT * X_ET;
    }
    return Done{};
  }
  if (comes_once(options, input.stream())) {
    return add_path_at_first_sight(options, tool, input);
  }
  const std::string scene = scene_name(options);
  if (!scene.empty() && !is_aimed(options.aim)) return add_path_of_scene(scene, input);
  return add_probing_path(
      options, tool, [&] { return open_stream(options, first_camera(options), options.duration); },
      input);
}

Status add_sources(const TouchOptions& options, TouchInput& input) {
  // A run with a hand has no fixed length, and begins at its first tick, long after the first
  // frame.
  constexpr double kLongest = 86400;
  const bool is_live = !options.device.empty();
  for (const CameraUri& camera : options.cameras) {
    std::optional<Pose> X_FC;
    auto source =
        open_stream(options, camera, is_live ? std::optional(kLongest) : options.duration, &X_FC);
    if (!source) return source.error();
    if (input.sources.empty()) input.X_FC = X_FC.value_or(Pose{});
    input.sources.push_back(*std::move(source));
  }
  return Done{};
}

/// Aligns the clocks of path and frames. Time stamps since 1970 are never shifted silently.
Status set_clocks(const TouchOptions& options, TouchInput& input) {
  input.path_start = input.path.empty() ? 0 : input.path.front().time;
  input.time_origin = input.path_start;
  const bool has_file = !options.path.empty() || options.is_replay();
  const bool is_recorded = scene_name(options).empty() && !comes_once(options, input.stream());
  if (!is_recorded || !has_file) {
    if (options.align != Align::stamps) return Done{};
    return Error{Errc::invalid_argument,
                 "--align stamps goes with recorded frames, which have time stamps of their own; " +
                     input.stream().name + " and the path begin at once"};
  }
  const auto frame =
      first_frame([&] { return open_stream(options, first_camera(options), options.duration); });
  if (!frame) return frame.error();
  const double first = frame->timestamp;
  const bool path_counts = counts_from_1970(input.path_start),
             frames_count = counts_from_1970(first);
  const bool by_stamps = options.align == Align::stamps ||
                         (options.align == Align::automatic && path_counts && frames_count);
  if (!by_stamps) {
    if (frames_count && !path_counts) input.time_origin = first;
    if (options.align == Align::automatic && path_counts != frames_count) {
      print_note(std::string("only the ") +
                 (path_counts ? "path's time stamps count" : "frames' time stamps count") +
                 " from 1970: path and frames begin at once (--align starts)");
    }
    return Done{};
  }
  const DepthStreamInfo& info = input.stream();
  const double last = first + info.num_frames.value_or(1) / info.rate;
  const double path_end = input.path.back().time;
  if (first > path_end || last < input.path_start) {
    const auto range = [](double from, double to) {
      char text[80];
      std::snprintf(text, sizeof text, "%.3f to %.3f s", from, to);
      return std::string(text);
    };
    return Error{Errc::bad_input,
                 "the path (" + range(input.path_start, path_end) + ") and the depth frames (" +
                     range(first, last) +
                     ") have no time in common; check their clocks, or let both begin at once: "
                     "--align starts"};
  }
  input.path_start = input.time_origin = std::max(input.path_start, first);
  input.frame_zero = input.path_start;
  if (!options.device.empty()) {
    for (auto& source : input.sources) {
      source = std::make_unique<FramesFrom>(std::move(source), *input.frame_zero);
    }
  }
  return Done{};
}

}  // namespace

Status find_connected(TouchOptions& options) {
  if (!options.rig.empty()) {
    auto rig = load_rig(options.rig);
    if (!rig) return rig.error();
    for (const CameraRig::Camera& camera : rig->cameras) options.cameras.push_back(camera.uri);
    options.rig_read = *std::move(rig);
  }
  if (options.cameras.empty()) {
    auto camera = connected_camera();
    if (!camera) return camera.error();
    use_sensor(options.sensor, *camera);
    options.cameras = {*camera};
    print_note("taking the camera " + camera->text);
  }
  if (const Status status = check_one_world(options.cameras); !status) return status;
  warn_of_twins(options.cameras);
  auto filter = open_robot(options.robot, options.cameras);
  if (!filter) return filter.error();
  options.self_filter = *std::move(filter);
  if (options.device == "auto") {
    const auto device = connected_device();
    if (!device) return device.error();
    options.device = *device;
    print_note("taking the device " + *device);
  }
  return Done{};
}

Status know_frames(TouchOptions& options) {
  auto frames = NamedFrames::of(options.cameras);
  if (!frames) return frames.error();
  Status status = options.rig_read ? frames->add(*options.rig_read) : Done{};
  if (status) status = put_in_world(*frames, options.frames, options.settings);
  if (status && options.is_given("coupling.base_in_scene")) {
    status = frames->add("device", options.settings.coupling.X_WB);
  }
  if (status) status = put_in_world(*frames, options.objects);
  if (!status) return status;
  if (!options.is_path_of_handle()) {
    const auto X_WF = frames->find(options.frames.path);
    if (!X_WF) return X_WF.error();
    options.X_WF = *X_WF;
  }
  const auto gravity = options.rig_read ? options.rig_read->gravity : gravity_seen(options.cameras);
  BodyOptions& bodies = options.settings.bodies;
  const bool is_given = options.is_given("bodies.gravity_x") ||
                        options.is_given("bodies.gravity_y") ||
                        options.is_given("bodies.gravity_z");
  if (gravity && !is_given) {
    bodies.gravity_x = gravity->x;
    bodies.gravity_y = gravity->y;
    bodies.gravity_z = gravity->z;
  }
  const Vec3d used{bodies.gravity_x, bodies.gravity_y, bodies.gravity_z};
  for (const std::string& doubt : gravity_doubts(options.cameras, used)) print_note(doubt);
  return Done{};
}

Result<TouchInput> open_touch_input(const TouchOptions& options, const Tool& tool) {
  TouchInput input;
  if (const Status status = add_sources(options, input); !status) return status.error();
  if (const Status status = add_path(options, tool, input); !status) return status.error();
  if (const Status status = set_clocks(options, input); !status) return status.error();
  return input;
}

}  // namespace palpate::apps
