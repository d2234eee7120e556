// Topics of a run for people who look at it, e.g. in RViz: the measured points, the meshes, and the
// spheres of the tool by their state. A sphere is unseen if it lies behind the surface in the last
// image of every camera; so these images are kept.
#pragma once

#include <functional>
#include <memory>
#include <mutex>
#include <span>
#include <string>
#include <vector>

#include "apps/ros/ros_output.h"
#include "src/io/internal/ros_messages.h"
#include "src/ros/internal/ros_node.h"

namespace palpate::apps {

/// Makes the publisher of a topic. Error: what RosNode::publish says.
using MakeRosPublisher =
    std::function<Status(std::unique_ptr<RosPublisher>& to, const std::string& topic,
                         const char* type, const RosQos& qos)>;

/// Points and spheres are published only while somebody reads them, at most `points_rate` times per
/// second. `publish_points` and `keep` are called by the thread of the observer, `publish_spheres`
/// by another one.
class RosDisplay {
 public:
  /// All of them must outlive it.
  RosDisplay(const Tool& tool, const std::vector<DepthStreamInfo>& streams,
             const RosOutputOptions& options)
      : tool_(tool), streams_(streams), options_(options) {
    seen_.resize(streams_.size());
    sphere_states_.resize(tool_.spheres().size());
  }

  Status open(const MakeRosPublisher& publish);
  /// Publishes the meshes of the tool and of bodies, for late subscribers too.
  void publish_meshes(std::span<const RosBody> bodies);
  void publish_points(const FrameRecord& record, const DepthFrame& frame);
  /// Keeps the last image of each camera, by which `publish_spheres` says what is unseen.
  void keep(const FrameRecord& record, const DepthFrame& frame);
  /// Publishes the states of the spheres at the contact requested before, and requests the next
  /// one. `time`: now, s, monotonic.
  void publish_spheres(RunLoop& loop, double time);

 private:
  bool is_seen(const Vec3d& p_W) const;

  const Tool& tool_;
  const std::vector<DepthStreamInfo>& streams_;
  const RosOutputOptions& options_;
  std::unique_ptr<RosPublisher> points_, spheres_, markers_;

  struct Seen {
    double time = -1e9;  // s
    Pose X_WC;
    DepthFrame frame;
  };
  std::mutex seen_mutex_;   // guards seen_ between the two threads
  std::vector<Seen> seen_;  // of each camera
  double next_points_ = 0;  // s, of the observer's thread

  // State of the thread that publishes the spheres.
  std::vector<RosSphere> sphere_states_;
  double next_spheres_ = 0;  // s
};

}  // namespace palpate::apps
