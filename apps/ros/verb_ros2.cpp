// palpate ros2: a robot's tool, or all of a robot, in a robot's depth images, as a node of ROS 2.

#include <memory>

#include "apps/page.h"
#include "apps/ros/robot_guard.h"
#include "apps/touch/touch.h"
#include "apps/verbs.h"

namespace palpate::apps {
namespace {

struct Options {
  TouchOptions touch;
  GuardOptions guard;
  std::vector<std::string> depths, camera_infos;
  std::string world, clock = "own", qos = "best_effort", tool_frame, pose;
  double latency = 0;  // s
  double scale = 1;    // m per number of a 32FC1 image
};

/// Returns the options of the equivalent palpate touch --camera ros2:... --device ros2:... --ros2.
TouchOptions touch_options(const Options& options) {
  TouchOptions touch = options.touch;
  if (!options.camera_infos.empty() && options.camera_infos.size() != options.depths.size()) {
    usage_error("ros2: give --camera-info as often as --depth, in the same order, or not at all");
  }
  if (options.depths.size() > 1 && options.world.empty()) {
    usage_error("ros2: several cameras need a common tf frame: pass --world FRAME");
  }
  touch.cameras.clear();
  for (std::size_t k = 0; k < options.depths.size(); ++k) {
    std::string uri = "ros2:" + options.depths[k] + "?qos=" + options.qos +
                      "&clock=" + options.clock + "&latency=" + shortest_decimal(options.latency);
    if (!options.camera_infos.empty()) uri += "&info=" + options.camera_infos[k];
    if (!options.world.empty()) uri += "&world=" + options.world;
    if (options.scale != 1) uri += "&scale=" + shortest_decimal(options.scale);
    const auto camera = parse_camera_uri(uri);
    if (!camera) usage_error("ros2: --depth: " + camera.error().message);
    touch.cameras.push_back(*camera);
  }
  touch.ros.is_requested = true;
  RobotFiles& robot = touch.robot.files;
  if (touch.tool.empty()) {
    if (robot.pose.empty() && options.world.empty()) {
      usage_error(
          "ros2: --robot needs the pose of its base in the camera's frame: pass --robot-pose, or "
          "--world FRAME, where tf has the camera in the frame of the base");
    }
    if (robot.joints.empty()) robot.joints = "ros2:/joint_states";
    return touch;
  }
  if (options.tool_frame.empty() == options.pose.empty()) {
    usage_error("ros2: needs the tool's pose: pass --tool-frame FRAME (of tf) or --pose /TOPIC");
  }
  touch.device = "ros2:" + (options.pose.empty() ? options.tool_frame : options.pose);
  if (!touch.ros.camera_frame.empty()) touch.device += "@" + touch.ros.camera_frame;
  if (options.clock == "shared") touch.device += "?clock=shared";
  if (!options.tool_frame.empty()) touch.ros.tool_frame = options.tool_frame;
  if (robot.robot.ends_with(".urdf") && robot.joints.empty()) {
    if (robot.pose.empty() && options.world.empty()) {
      usage_error(
          "ros2: --robot needs the pose of its base: pass --world FRAME to take its links from tf, "
          "or --robot-pose to take joint positions from /joint_states");
    }
    robot.joints = robot.pose.empty() ? "ros2:?world=" + options.world : "ros2:/joint_states";
  }
  return touch;
}

}  // namespace

void add_ros2(CLI::App& program, Action& action) {
  const auto options = std::make_shared<Options>();
  TouchOptions& touch = options->touch;
  touch.output = "palpate-ros2";
  touch.recording.keep_seconds = 60;
  CLI::App& app = *program.add_subcommand(
      "ros2",
      "Be a node of ROS 2: depth images and poses in, a wrench or a robot's clearance out.");
  app.add_option("tool", touch.tool, "tool file; none: all of --robot")->type_name("TOOL.palp");
  app.add_option("--depth", options->depths,
                 "depth images: Image, .../compressedDepth, or PNG of .../compressed; or clouds: "
                 "PointCloud2; once for each camera")
      ->required()
      ->allow_extra_args(false)
      ->type_name("TOPIC");
  app.add_option("--camera-info", options->camera_infos,
                 "their CameraInfo; default: camera_info beside the images")
      ->allow_extra_args(false)
      ->type_name("TOPIC");
  add_number(app, "--depth-scale", options->scale, {1e-6, 1000, "m"},
             "meters per number of 32FC1 images: 0.001 if they are in millimeters");
  app.add_option("--world", options->world,
                 "tf frame in which cameras are placed, each image by its stamp; default: one "
                 "camera, which is the world")
      ->type_name("FRAME");
  app.add_option("--clock", options->clock,
                 "clock of the stamps: the robot's own, one shared with this computer (PTP, NTP), "
                 "so that ages include the network delay, or a simulator's, which may be slow, so "
                 "that ages begin at the arrival: own, shared, arrival")
      ->check(CLI::IsMember({"own", "shared", "arrival"}).description(""))
      ->type_name("NAME")
      ->capture_default_str();
  add_number(app, "--latency", options->latency, {0, 1, "s"},
             "from the exposure of an image to its stamp, where drivers stamp late");
  app.add_option("--qos", options->qos,
                 "reliability of the image subscription: best_effort, reliable")
      ->check(CLI::IsMember({"best_effort", "reliable"}).description(""))
      ->type_name("NAME")
      ->capture_default_str();
  auto* const frame =
      app.add_option("--tool-frame", options->tool_frame, "tf frame of the tool: that of its mesh")
          ->type_name("FRAME");
  app.add_option("--pose", options->pose, "topic of the tool's PoseStamped (frame of its mesh)")
      ->type_name("TOPIC")
      ->excludes(frame);
  add_object_option(app, touch.objects, true);
  add_robot_options(app, touch.robot);
  add_guard_options(app, options->guard);
  app.add_option("-o,--output", touch.output, "folder of the recording of the last minute")
      ->type_name("RUN")
      ->capture_default_str();
  add_seconds_option(app, "--duration", touch.duration, "length of the run; default: until Ctrl-C");
  const SettingTable table = settings_of(touch.settings);
  add_setting_options(app, "Speed", table, kLoopOptions);
  add_prefix_option(app, touch.num_spheres);
  add_setting_options(app, "Contact", table, kContactOptions);
  add_threads_option(app, touch.settings.num_threads, kThreadsHelp);
  add_setting_options(app, "From depth to surface", table, kSurfaceOptions);
  add_set_option(app, table);
  add_ros_options(app, touch.ros);
  add_output_options(app, touch.frames, touch.settings);
  app.add_flag("--view", touch.has_page, "show the run in a browser");
  app.option_defaults()->group("Page in a browser");
  add_page_options(app, "--view-", touch.page);
  app.option_defaults()->group("Options");
  app.add_flag("--json", touch.json, "print the summary as JSON");
  app.footer(
      "ROS_DOMAIN_ID and ROS_LOCALHOST_ONLY are respected. No ROS installation is needed.\n"
      "Example: palpate ros2 gripper.palp --depth /camera/depth/image_rect_raw --tool-frame tool0\n"
      "         palpate ros2 --robot arm.palprobot --world base_link --depth "
      "/camera/depth/image_rect_raw");
  app.callback([options, &app, &action] {
    check_robot(app, "ros2");
    check_guard(app, options->touch);
    check_use(app, options->touch.settings);
    TouchOptions ready = touch_options(*options);
    if (ready.tool.empty()) {
      ready.given = given_settings(app, {kContactOptions, kSurfaceOptions});
      action = [ready, guard = options->guard] { return run_guard(ready, guard); };
      return;
    }
    check_ros_output(ready.ros, ready.frames.wrench, ready.settings.output, "ros2");
    action = [ready] { return run_touch(ready); };
  });
}

}  // namespace palpate::apps
