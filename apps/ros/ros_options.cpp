// Options of the topics of a run over ROS 2, for the verbs that publish them: they are declared and
// checked here, so that every verb has the same ones.
#include <algorithm>

#include "apps/ros/ros_output.h"

namespace palpate::apps {

void add_ros_options(CLI::App& app, RosOutputOptions& options) {
  const std::string group = "ROS 2";
  app.add_option("--wrench", options.wrench, "topic of the wrench")
      ->type_name("TOPIC")
      ->capture_default_str()
      ->group(group);
  app.add_option("--ros2-namespace", options.name_space,
                 "namespace of all topics except /diagnostics")
      ->type_name("NAMESPACE")
      ->capture_default_str()
      ->group(group);
  app.add_option("--ros2-camera-frame", options.camera_frame,
                 "frame id of the published poses: the camera's, or the world's where cameras have "
                 "poses; default: that of its images")
      ->type_name("FRAME")
      ->group(group);
  add_number(app, "--wrench-rate", options.rate, {1, 1000, "Hz"}, "wrenches per second")
      ->group(group);
  add_number(app, "--contact-message-rate", options.contact_rate, {0.1, 1000, "Hz"},
             "contacts and poses of the tool and of moving objects per second")
      ->group(group);
  add_number(app, "--points-rate", options.points_rate, {0, 30, "Hz"},
             "point clouds per second, at most; 0: none")
      ->group(group);
  add_number(app, "--max-age", options.max_age, {0.001, 10, "s"},
             "the wrench is zero when the depth image, the measurement or the tool's pose is older")
      ->group(group);
}

void check_ros_output(const RosOutputOptions& options, const std::string& frame,
                      const OutputOptions& output, const std::string& verb) {
  if (!options.is_requested) return;
  if (!(output.X_TE == Pose{}) || output.wrench_point != WrenchPoint{}) {
    usage_error(verb +
                ": over ROS 2 a wrench refers to the origin of its frame: remove --tcp and "
                "--wrench-point, and add a tf frame at the tool center point");
  }
  const std::initializer_list<std::string_view> known{"", "auto", "tool", "camera", "world"};
  const bool is_known = std::ranges::find(known, frame) != known.end();
  const auto& set = output.wrench_frame;
  if (is_known && set != WrenchFrame::device && set != WrenchFrame::named) return;
  usage_error(verb +
              ": over ROS 2 --wrench-frame must be tool, or the frame of the poses (camera or "
              "world); use tf to transform the wrench to another frame");
}

}  // namespace palpate::apps
