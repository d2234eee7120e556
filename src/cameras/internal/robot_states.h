// States of a robot's joints and frames from files, recordings or ROS 2.
#pragma once

#include <condition_variable>
#include <limits>
#include <map>
#include <memory>
#include <mutex>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "palpate/io/files.h"
#include "src/cameras/robot/joint_history.h"
#include "src/cameras/stream/capture_clock.h"
#include "src/ros/internal/tf_history.h"

namespace palpate { inline namespace v0 {

/// Source of the states.
struct StateAddress {
  enum class Kind { table, bag, ros2 };
  Kind kind = Kind::table;
  std::string text;              ///< as it was given, for humans
  std::string target;            ///< file, or topic of JointState; of a bag that is `topic`
  std::string topic;             ///< empty: all of JointState in the bag
  std::string world;             ///< frame of tf that is W: poses of links, not joints
  bool goes_by_arrival = false;  ///< stamps are of another clock than those of images
};
/// FILE.csv, bag:FILE[?topic=/T], ros2:[/T], and the last two with ?world=FRAME; ros2: with
/// &match=stamps|arrival. Error: a parameter that there is not.
Result<StateAddress> parse_state_address(std::string_view text);

/// Everything received so far, or all of a file. Any threads.
class RobotStates {
 public:
  /// Errors: a file that cannot be read; no Cyclone DDS here.
  static Result<std::unique_ptr<RobotStates>> open(const StateAddress& address,
                                                   std::vector<JointHistory::Joint> joints);
  RobotStates(StateAddress address, std::vector<JointHistory::Joint> joints);
  virtual ~RobotStates() = default;

  /// True if states go on coming.
  virtual bool is_live() const { return false; }

  /// When a frame was captured. Live it is looked for by its stamp, as messages say it, if both
  /// have one, as has everything received in the last 5 s; else on the monotonic clock of this
  /// computer, where each message's time counts from the earliest that it can have come.
  struct Moment {
    double time = 0;       ///< s, on the clock of the frames
    double stamp = 0;      ///< s; 0: none
    double max_age = 0.1;  ///< s, largest distance of a state from it
    bool waits = true;     ///< live: until it is known, at most max_age
  };
  /// Positions of all joints at a moment. Live, waits as it says; then they are extrapolated.
  /// Error: as of JointHistory::at.
  Status positions(const Moment& moment, std::vector<double>& positions) const;
  /// Links in the world at a moment. Live, waits until they are known, at most `max_age`; nothing
  /// is extrapolated (as in tf2). Error: a link without a transform.
  Status links_in_world(std::span<const std::string> links, const Moment& moment,
                        std::span<Pose> X_WL) const;
  /// Joints without any state; of `links`, those without any transform.
  std::string missing_joints() const;
  std::string missing_links(const std::vector<std::string>& links) const;

 protected:
  void add_joint_message(std::string_view message);
  void add_transform_message(std::string_view message, bool is_static);
  /// Converts a time stamp to the clock of the frames; `who` may have a clock of its own.
  virtual double time_of(double stamp, [[maybe_unused]] const std::string& who) { return stamp; }

  /// Live, if everything received in the last seconds has stamps.
  bool goes_by_stamps() const;
  /// True if a message that came now counts by its stamp, too. One without ends that for all.
  bool counts_by_stamp(bool has_stamp);

  struct Histories {
    JointHistory joints;
    TfHistory transforms;
  };
  /// The states by stamps or by arrival, and the moment on their clock. Waits until `known_until`.
  template <class KnownUntil>
  std::pair<const Histories&, double> states_at(std::unique_lock<std::mutex>& lock,
                                                const Moment& moment,
                                                const KnownUntil& known_until) const;

  const StateAddress address_;
  const std::size_t num_joints_;
  mutable std::mutex mutex_;
  mutable std::condition_variable changed_;
  Histories by_time_, by_stamp_;  // the latter live only
  const bool may_go_by_stamps_;
  double unstamped_at_ = -std::numeric_limits<double>::infinity();  // s, when the newest came
};

/// Reads poses of a robot's base over time from a trajectory file, or from one pose; nothing: the
/// identity. Errors: neither a file nor a pose; those of the file.
Result<std::vector<TimedPose>> base_poses(const std::string& text);

}}  // namespace palpate::v0
