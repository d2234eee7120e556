#include "apps/touch/frames.h"

#include <algorithm>

#include "palpate/io/files.h"

namespace palpate::apps {
namespace {

/// Parses 'x y z', or that with a quaternion.
Pose parse_tcp(const std::string& text) {
  std::string blanks = text;
  std::ranges::replace(blanks, ',', ' ');
  const auto pose = parse_pose(blanks);
  const auto point = parse_pose(blanks + " 0 0 0 1");
  if (!pose && !point) {
    usage_error("--tcp: must be 'x y z' or 'x y z qx qy qz qw' in the frame of the mesh, m, not '" +
                text + "'");
  }
  return pose ? *pose : *point;
}

/// True unless the name is a word of --wrench-frame or --path-frame with another meaning.
bool is_free(const std::string& name) {
  const std::initializer_list<std::string_view> words{"auto", "base", "tool", "device", "named"};
  return std::ranges::find(words, name) == words.end();
}

Error taken(const std::string& name) {
  return {Errc::bad_input, "two frames are called '" + name +
                               "', or the name is reserved: rename the frame in the rig"};
}

}  // namespace

void add_output_options(CLI::App& app, FrameOptions& options, RunSettings& settings) {
  const std::string group = "Frames";
  app.add_option(
         "--wrench-frame", options.wrench,
         "frame of the reported pose and wrench (columns reported_* of wrench.csv, \"reported\" "
         "of query): world, camera, tool, device, or a frame of the rig; over ROS 2: "
         "tool, or camera for the frame of the poses there")
      ->type_name("FRAME")
      ->group(group);
  SettingTable table = settings_of(settings);
  add_setting(app, "--wrench-point", *table.find("output.wrench_point"))->group(group);
  app.add_option_function<std::string>(
         "--tcp", [&settings](const std::string& text) { settings.output.X_TE = parse_tcp(text); },
         "tool center point (TCP) in the frame of its mesh, m: reference of all input and "
         "output poses, and of torques with --wrench-point tcp")
      ->type_name("'x y z [qx qy qz qw]'")
      ->group(group);
}

Result<NamedFrames> NamedFrames::of(std::span<const CameraUri> cameras) {
  NamedFrames frames;
  for (std::size_t i = 0; i < cameras.size(); ++i) {
    const auto X_WC = standing_pose(cameras[i]);
    if (!X_WC) return X_WC.error();
    frames.frames_[i == 0 ? "camera" : "camera_" + std::to_string(i + 1)] = *X_WC;
  }
  return frames;
}

Status NamedFrames::add(const std::string& name, const Pose& X_WF) {
  return frames_.emplace(name, X_WF).second ? Status(Done{}) : taken(name);
}

/// A camera may also have its default name: camera, camera_2, ...
Status NamedFrames::add_of_rig(const std::string& name, const std::optional<Pose>& X_WF) {
  const auto [known, is_new] = frames_.emplace(name, X_WF);
  const bool is_same = known->second && X_WF && *known->second == *X_WF;
  if (is_new ? is_free(name) : is_same) return Done{};
  return taken(name);
}

Status NamedFrames::add(const CameraRig& rig) {
  for (const CameraRig::Camera& camera : rig.cameras) {
    const auto X_WC = standing_pose(camera.uri);
    if (!X_WC) return X_WC.error();
    if (const Status status = add_of_rig(camera.name, *X_WC); !status) return status;
  }
  if (const Status status = add_of_rig(rig.frame, Pose{}); !status) return status;
  for (const auto& [name, X_WF] : rig.frames) {
    if (!is_free(name)) return taken(name);
    if (const Status status = add(name, X_WF); !status) return status;
  }
  return Done{};
}

Result<Pose> NamedFrames::find(const std::string& name) const {
  const auto found = frames_.find(name.empty() ? "world" : name);
  if (found != frames_.end() && found->second) return *found->second;
  if (found != frames_.end()) {
    return Error{
        Errc::bad_input,
        "the frame '" + name +
            "' moves, or is placed by tf: give coordinates in the world or in a static frame"};
  }
  std::string known;
  for (const auto& [each, X_WF] : frames_) known += (known.empty() ? "" : ", ") + each;
  return Error{Errc::bad_input,
               "there is no frame '" + name.substr(0, 60) + "'; there are " + known};
}

Status put_in_world(const NamedFrames& frames, const FrameOptions& options, RunSettings& settings) {
  const auto X_WF = frames.find(options.base);
  if (!X_WF) return X_WF.error();
  if (!options.base.empty()) settings.coupling.X_WB = *X_WF * settings.coupling.X_WB;
  OutputOptions& output = settings.output;
  if (options.wrench.empty()) return Done{};
  if (options.wrench == "auto") {
    output.wrench_frame.reset();
    return Done{};
  }
  output.wrench_frame = value_named<WrenchFrame>(options.wrench);
  if (output.wrench_frame) return Done{};
  const auto X_WN = frames.find(options.wrench);
  if (!X_WN) return X_WN.error();
  output.wrench_frame = WrenchFrame::named;
  output.X_WN = *X_WN;
  return Done{};
}

Status put_in_world(const NamedFrames& frames, std::vector<ObjectOption>& objects) {
  for (ObjectOption& object : objects) {
    const auto X_WF = frames.find(object.frame);
    if (!X_WF) return X_WF.error();
    object.X_WB = *X_WF * object.X_WB;
    object.frame.clear();
  }
  return Done{};
}

}  // namespace palpate::apps
