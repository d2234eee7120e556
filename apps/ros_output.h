// What a run publishes over ROS 2.
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
  double max_age = 0.1;                                     ///< s, of what a wrench rests on
};
/// Of a verb; their group in its help is "ROS 2".
void add_ros_options(CLI::App& app, RosOutputOptions& options);
/// Wrong usage: --wrench-frame is one that no frame of ROS 2 stands for, or torques are requested
/// about a point that is not the origin of a frame.
void check_ros_output(const RosOutputOptions& options, const std::string& frame,
                      const OutputOptions& output, const std::string& verb);

/// Publishes the wrench from a thread of its own, which looks at the newest tick: the haptic thread
/// knows nothing of it. Everything else is published by another thread of lower priority. A wrench
/// that rests on what is older than `max_age` is zero, and says why.
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
  /// `tool` must outlive it. Errors: no Cyclone DDS, what it says.
  static Result<std::unique_ptr<RosOutput>> create(const Tool& tool,
                                                   const std::vector<SceneObject>& objects,
                                                   std::vector<DepthStreamInfo> streams,
                                                   const RosOutputOptions& options);
  virtual ~RosOutput() = default;
  /// Gets what the monitor gets, before it. Call once, before the run.
  virtual void join(RunMonitor& monitor) = 0;
};

}  // namespace palpate::apps
