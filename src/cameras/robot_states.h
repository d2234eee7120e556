// What is told of a robot's joints and frames, by files, recordings or ROS 2.
#pragma once

#include <map>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "src/cameras/capture_clock.h"
#include "src/cameras/joint_history.h"
#include "src/ros/tf_history.h"

namespace palpate {

/// Where it is told.
struct StateAddress {
  enum class Kind { table, bag, ros2 };
  Kind kind = Kind::table;
  std::string text;    ///< as it was given, for humans
  std::string target;  ///< file, or topic of JointState; of a bag that is `topic`
  std::string topic;   ///< empty: all of JointState in the bag
  std::string world;   ///< frame of tf that is W: places of links are told, not joints
};
/// FILE.csv, bag:FILE[?topic=/T], ros2:[/T], and the last two with ?world=FRAME. Error: a parameter
/// that there is not.
Result<StateAddress> parse_state_address(std::string_view text);

/// What was told so far, or all that ever was. Any threads.
class RobotStates {
 public:
  /// Errors: a file that cannot be read; no Cyclone DDS here.
  static Result<std::unique_ptr<RobotStates>> open(const StateAddress& address,
                                                   std::vector<JointHistory::Joint> joints);
  RobotStates(StateAddress address, std::vector<JointHistory::Joint> joints);
  virtual ~RobotStates() = default;

  /// On the monotonic clock of this computer, and goes on.
  virtual bool is_live() const { return false; }

  /// Positions of all joints at a time. Error: as of JointHistory::at.
  Status positions(double time, double max_age, std::vector<double>& positions) const;
  /// Link in the world at a time.
  std::optional<Pose> link_in_world(const std::string& link, double time, double max_age) const;
  /// Joints of which nothing has been told; of `links`, those that no transform ever placed.
  std::string missing_joints() const;
  std::string missing_links(const std::vector<std::string>& links) const;

 protected:
  void hear_joints(std::string_view message);
  void hear_transforms(std::string_view message, bool is_static);
  /// From a time stamp to the clock of the frames; `who` may have one of his own.
  virtual double time_of(double stamp, [[maybe_unused]] const std::string& who) { return stamp; }

  const StateAddress address_;
  const std::size_t num_joints_;
  mutable std::mutex mutex_;
  JointHistory joints_;
  TfHistory transforms_;
};

}  // namespace palpate
