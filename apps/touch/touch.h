// The options of palpate touch, and its inputs.
#pragma once

#include <algorithm>
#include <array>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "apps/options.h"
#include "apps/page.h"
#include "apps/ros/ros_output.h"
#include "apps/sensor_choice.h"
#include "apps/touch/frames.h"
#include "apps/touch/materials.h"
#include "apps/touch/objects.h"
#include "apps/touch/robot.h"
#include "palpate/cameras/cameras.h"
#include "palpate/io/files.h"
#include "palpate/session/run.h"
#include "src/session/internal/probing_path.h"

namespace palpate::apps {

/// Alignment of the times of a path and of depth frames.
enum class Align {
  automatic,  ///< by their time stamps if both count from 1970, else both begin at once
  stamps,     ///< by their time stamps
  starts,     ///< both begin at once
};
constexpr auto names_of(Align) { return std::array{"auto", "stamps", "starts"}; }

struct TouchOptions {
  std::string tool, path, output;
  std::vector<CameraUri> cameras;  ///< empty: those of the rig, or the only connected one
  std::string rig;                 ///< file; empty: none
  std::optional<CameraRig> rig_read;
  SensorChoice sensor;  ///< its kind is of the only connected camera
  RobotOptions robot;
  std::optional<SelfFilter> self_filter;  ///< of that robot, once it is open
  RunSettings settings;
  std::vector<std::string> given;  ///< keys of settings that the user gave
  Status settings_read = Done{};   ///< of --settings
  std::vector<ObjectOption> objects;
  MaterialOptions materials;
  std::optional<double> duration;
  ProbeAim aim;  ///< of a generated path
  std::string
      device;  ///< empty: the tool follows a path on a simulated clock; "auto": the connected one
  Align align = Align::automatic;
  FrameOptions frames;
  Pose X_WF;            ///< of the frame that the poses of a path are in
  int num_spheres = 0;  ///< 0: all
  bool json = false;
  RecordingOptions recording;
  bool has_page = false;
  PageOptions page;
  RosOutputOptions ros;

  bool is_given(std::string_view key) const { return std::ranges::find(given, key) != given.end(); }
  bool is_replay() const { return device.starts_with("replay:"); }
  bool is_path_of_handle() const { return frames.path == "base"; }
  bool is_robot() const { return device.starts_with("ros2:"); }  ///< which holds the tool
  bool is_page() const { return device == "page"; }  ///< of the viewer, which holds the tool
  bool is_simulated_hand() const { return device == "sim" || device.starts_with("sim:"); }
};

/// Depth frames, and the path for them.
struct TouchInput {
  std::vector<std::unique_ptr<DepthSource>> sources;  ///< of each camera
  std::vector<TimedPose> path;                        ///< X_WT, or X_BH where the options say so
  std::optional<ProbeChoice> probe;                   ///< if the path is generated
  std::optional<Pose> X_WC;          ///< of the first camera, if the path is generated
  Pose X_FC;                         ///< of its clouds, if they are projected
  double path_start = 0;             ///< on the path's clock: when the run begins
  std::optional<double> frame_zero;  ///< on that of the frames; none: with the first one
  double time_origin = 0;            ///< of wrench.csv: when the run begins

  /// The camera for which a path is generated.
  const DepthStreamInfo& stream() const { return sources.front()->info(); }
};

/// Finds cameras and device, if they are not named, and opens the robot. Errors: those of the rig
/// and of the robot; none, or several.
Status find_connected(TouchOptions& options);

/// Transforms options given in named frames into the world, and takes gravity from the rig or the
/// cameras. Errors: an unknown frame, or one that moves.
Status know_frames(TouchOptions& options);

/// Opens frames and path, generates a path if there is none, and aligns their clocks. Errors: files
/// that cannot be read; clocks that have nothing in common.
Result<TouchInput> open_touch_input(const TouchOptions& options, const Tool& tool);

/// Checks which options go with the page that shows the run.
void check_view(const CLI::App& app, const TouchOptions& options);
/// Checks which options go with a device or with a path.
void check_motion(const CLI::App& app, const TouchOptions& options);
/// Checks options that need friction or a ROS 2 node.
void check_feel(const CLI::App& app, const TouchOptions& options);
/// Checks that the options of contact go with its method.
void check_method(const TouchOptions& options);

/// Runs palpate touch: finds and opens its inputs, and runs the loop.
Status run_touch(const TouchOptions& options);

/// Runs the loop and prints the results.
Status touch(const TouchOptions& options, const Tool& tool, TouchInput input);

}  // namespace palpate::apps
