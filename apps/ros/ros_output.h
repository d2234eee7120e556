// Topics of a run over ROS 2.
#pragma once

#include <array>
#include <memory>
#include <string>
#include <vector>

#include "apps/options.h"
#include "palpate/session/run.h"

namespace palpate::apps {

struct RosOutputOptions {
  bool is_requested = false;
  std::string name_space = "/palpate";  ///< of the topics
  std::string wrench = "wrench";        ///< the topic; in the namespace unless it begins with "/"
  /// `camera_frame`: frame of published poses, W.
  std::string tool_frame = "palpate_tool", camera_frame;
  /// Frame of the published wrench (its origin and axes); if it is not the tool's, it is W.
  WrenchFrame frame = WrenchFrame::tool;
  double rate = 1000, contact_rate = 100, points_rate = 2;  ///< Hz
  double max_age = 0.1;                                     ///< s, of the inputs of a wrench
};
/// Adds the options to a verb; their group in its help is "ROS 2".
void add_ros_options(CLI::App& app, RosOutputOptions& options);
/// Ends in wrong usage if --wrench-frame has no frame in ROS 2, or torques are requested about a
/// point that is not the origin of a frame.
void check_ros_output(const RosOutputOptions& options, const std::string& frame,
                      const OutputOptions& output, const std::string& verb);

/// Publishes the wrench of the newest tick from a thread of its own, independent of the haptic
/// thread. Everything else is published by another thread of lower priority. A wrench with inputs
/// older than `max_age` is zero, with the reason.
///
///   NAMESPACE/wrench     geometry_msgs/WrenchStamped, on the tool
///   NAMESPACE/contact    palpate_msgs/Contact
///   NAMESPACE/tool_pose  geometry_msgs/PoseStamped, in the camera's frame or the world's
///   NAMESPACE/tool_twist geometry_msgs/TwistStamped, of the tool's origin, in its axes
///   /tf                  tf2_msgs/TFMessage, the frame NAMESPACE/NAME of each object that moves
///   NAMESPACE/points     sensor_msgs/PointCloud2, the measured points
///   NAMESPACE/markers    visualization_msgs/MarkerArray, meshes of the tool and of objects
///   NAMESPACE/spheres    visualization_msgs/MarkerArray, the tool's spheres by their state
///   /diagnostics         diagnostic_msgs/DiagnosticArray
class RosOutput {
 public:
  /// `tool` must outlive it. Errors: no Cyclone DDS, or its own message.
  static Result<std::unique_ptr<RosOutput>> create(const Tool& tool,
                                                   const std::vector<SceneObject>& objects,
                                                   std::vector<DepthStreamInfo> streams,
                                                   const RosOutputOptions& options);
  virtual ~RosOutput() = default;
  /// Gets the data of the monitor, before it. Call once, before the run.
  virtual void join(RunMonitor& monitor) = 0;
};

}  // namespace palpate::apps
