// How frames of ROS 2 lay to each other at any time of a recording.
#pragma once

#include <map>
#include <optional>
#include <string>
#include <vector>

#include "palpate/io/files.h"
#include "src/io/ros_messages.h"

namespace palpate {

/// All transforms of a recording, which may come in any order.
class TfHistory {
 public:
  void add(const RosStampedTransform& transform, bool is_static);
  /// Once, before the first question.
  void sort();

  /// Frame B in frame A at a time, s since 1970, between those that were told before and after it.
  /// None: nothing joins them, or a frame that moves was not told of within a second of that time.
  std::optional<Pose> find(const std::string& a, const std::string& b, double time) const;
  /// Whether anything between the two moves.
  bool is_moving(const std::string& a, const std::string& b) const;
  std::vector<std::string> frames() const;

 private:
  struct Link {
    std::string parent;
    bool is_static = false;
    std::vector<TimedPose> X_PC;
  };
  /// From a frame up to its root, with the names of those in between.
  std::vector<std::string> ancestors(const std::string& frame) const;
  std::optional<Pose> in_parent(const std::string& frame, double time) const;

  std::map<std::string, Link> links_;  // by child
};

}  // namespace palpate
