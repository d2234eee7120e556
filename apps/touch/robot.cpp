#include "apps/touch/robot.h"

#include <utility>

namespace palpate::apps {

void add_robot_options(CLI::App& app, RobotOptions& options) {
  const char* const group = "Self filter: a robot in the image";
  const auto add = [&](const char* flag, std::string& value, const char* type, const char* help) {
    app.add_option(flag, value, help)->type_name(type)->group(group);
  };
  add("--robot", options.files.robot, "FILE.urdf|MESH",
      "robot to remove from the depth images (self filter)");
  add("--joints", options.files.joints, "SOURCE",
      "joint positions: FILE.csv, bag:FILE[?topic=/T] or ros2:/TOPIC; bag:FILE?world=FRAME "
      "and ros2:?world=FRAME use the tf frames named like its links");
  add("--robot-pose", options.files.pose, "POSE|FILE",
      "pose of its base in the world: 'tx ty tz qx qy qz qw', or a file of poses by time (TUM)");
  add("--robot-packages", options.files.packages, "DIR[:DIR]",
      "folders searched for package://, in addition to ROS_PACKAGE_PATH and AMENT_PREFIX_PATH");
  app.add_option("--robot-skip", options.files.skip,
                 "links of the URDF that are not removed, and whose meshes are not read")
      ->type_name("LINK[,LINK]")
      ->delimiter(',')
      ->group(group);
  add_setting_options(app, group, settings_of(options.filter), kRobotOptions);
}

void check_robot(const CLI::App& app, const std::string& verb) {
  if (app.count("--robot") > 0) return;
  std::vector<std::string> flags{"--joints", "--robot-pose", "--robot-packages", "--robot-skip"};
  for (const SettingOption& option : kRobotOptions) flags.emplace_back(option.flag);
  for (const std::string& flag : flags) {
    if (app.count(flag) > 0) usage_error(verb + ": " + flag + " goes with --robot");
  }
}

Result<std::optional<SelfFilter>> open_robot(const RobotOptions& options,
                                             std::span<const CameraUri> cameras) {
  if (options.files.robot.empty()) return std::optional<SelfFilter>();
  if (const Status status = check_one_world(cameras, options.files); !status) return status.error();
  auto filter = open_self_filter(options.files, options.filter);
  if (!filter) return filter.error();
  return std::optional(*std::move(filter));
}

Result<std::unique_ptr<DepthSource>> without_robot(const std::optional<SelfFilter>& filter,
                                                   std::unique_ptr<DepthSource> source,
                                                   const Place& place) {
  if (!filter) return source;
  return filter->applied_to(std::move(source), place);
}

Place place_of_surfaces(const RunSettings& settings) {
  const Backend backend = settings.backend.value_or(find_gpus() ? Backend::cuda : Backend::cpu);
  return backend == Backend::cuda ? Place::cuda(settings.sensing_gpu) : Place::cpu();
}

}  // namespace palpate::apps
