// How frames of ROS 2 lay to each other at any time of a recording, or of the last seconds.
#pragma once

#include <limits>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include "palpate/io/files.h"
#include "src/io/ros_messages.h"

namespace palpate {

/// Transforms, which may come in any order.
class TfHistory {
 public:
  /// Of each frame, what is older than its newest one by more than that, s, is forgotten.
  explicit TfHistory(double kept_seconds = std::numeric_limits<double>::infinity())
      : kept_seconds_(kept_seconds) {}

  void add(const RosStampedTransform& transform, bool is_static);

  /// Frame B in frame A at a time, s since 1970, between those that were told before and after it.
  /// None: nothing joins them, or a frame that moves was not told of within `most_apart` s of that
  /// time.
  std::optional<Pose> find(const std::string& a, const std::string& b, double time,
                           double most_apart = 1) const;
  /// Until when all that moves between the two is known, s; infinity if nothing may. Minus
  /// infinity: nothing joins them.
  double known_until(const std::string& a, const std::string& b) const;
  /// Whether anything between the two moves, as far as it was told.
  bool is_moving(const std::string& a, const std::string& b) const;
  std::vector<std::string> frames() const;

 private:
  struct Link {
    std::string parent;
    bool is_static = false;
    std::vector<TimedPose> X_PC;
  };
  /// From a frame up to the first one that is above the other, too; and the other way.
  struct Chains {
    std::vector<std::string> of_a, of_b;
  };
  std::optional<Chains> chains_between(const std::string& a, const std::string& b) const;
  /// From a frame up to its root, with the names of those in between.
  std::vector<std::string> ancestors(const std::string& frame) const;
  std::optional<Pose> in_parent(const std::string& frame, double time, double most_apart) const;

  double kept_seconds_;
  std::map<std::string, Link> links_;  // by child, poses by time
};

}  // namespace palpate
