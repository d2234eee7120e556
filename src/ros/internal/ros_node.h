// One node of ROS 2 in this process: what it publishes and receives, and how it appears in the
// graph. Messages are bytes as src/io makes and reads them.
#pragma once

#include <array>
#include <cstdint>
#include <functional>
#include <memory>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "palpate/core/core.h"

namespace palpate { inline namespace v0 {

/// Quality of service that publishers offer and subscribers request.
struct RosQos {
  bool is_reliable = true;  ///< else best effort, which matches both kinds of publishers
  bool is_kept = false;     ///< transient local: late subscribers get the last ones, too
  int depth = 10;

  /// As robots send images: lost ones are not sent again.
  static RosQos sensor() { return {false, false, 5}; }
};

struct RosNodeOptions {
  std::string name = "palpate", node_namespace = "/";
  int domain = 0;
  bool is_local = false;  ///< nothing leaves this computer

  /// Domain and reach as ROS_DOMAIN_ID, ROS_LOCALHOST_ONLY and ROS_AUTOMATIC_DISCOVERY_RANGE say.
  /// Error: an invalid domain.
  static Result<RosNodeOptions> of_environment();
  friend bool operator==(const RosNodeOptions&, const RosNodeOptions&) = default;
};

class RosPublisher {
 public:
  virtual ~RosPublisher() = default;
  /// Any thread, one at a time. Never waits for readers; false: not sent.
  virtual bool publish(std::string_view message) = 0;
  virtual int num_readers() const = 0;
};

/// Calls its handler in a thread of its own, and never after it is destroyed.
class RosSubscription {
 public:
  virtual ~RosSubscription() = default;
  virtual int num_writers() const = 0;
};

struct RosTopic {
  std::string name, type;  ///< "/camera/depth/image_raw", "sensor_msgs/Image"

  friend auto operator<=>(const RosTopic&, const RosTopic&) = default;
};

class RosNode : public std::enable_shared_from_this<RosNode> {
 public:
  /// The node with these options: one in this process, while it is in use. Errors: no
  /// Cyclone DDS here; its own error.
  static Result<std::shared_ptr<RosNode>> join(const RosNodeOptions& options);
  static Result<std::shared_ptr<RosNode>> join();  ///< with those of the environment
  virtual ~RosNode() = default;

  /// Publishes messages of a type that ros_types.h knows. Names without "/" are in the node's
  /// namespace. Errors: not a valid topic name; what Cyclone DDS says.
  virtual Result<std::unique_ptr<RosPublisher>> publish(const std::string& topic,
                                                        const std::string& type,
                                                        const RosQos& qos) = 0;
  using MessageHandler = std::function<void(std::string_view message)>;
  virtual Result<std::unique_ptr<RosSubscription>> subscribe(const std::string& topic,
                                                             const std::string& type,
                                                             const RosQos& qos,
                                                             MessageHandler handler) = 0;
  /// Returns the topics of all publishers known by now, ours included.
  virtual std::vector<RosTopic> topics() = 0;
};

/// "/robot/wrench" of "wrench" in the namespace "/robot"; as it is if it begins with "/".
std::string full_topic(const std::string& topic, const std::string& node_namespace);
/// Error: not a valid topic name of ROS.
Status check_topic(const std::string& full_topic);

}}  // namespace palpate::v0
