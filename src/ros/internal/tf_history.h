// Relative poses of ROS 2 frames at any time of a recording, or of the last seconds.
#pragma once

#include <limits>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include "palpate/io/files.h"
#include "src/io/internal/ros_messages.h"
#include "src/ros/internal/by_time.h"

namespace palpate { inline namespace v0 {

/// Transforms, which may come in any order.
class TfHistory {
 public:
  /// Forgets samples of a frame that are older than its newest one by more than `kept_seconds`.
  explicit TfHistory(double kept_seconds = std::numeric_limits<double>::infinity())
      : kept_seconds_(kept_seconds) {}

  void add(const RosStampedTransform& transform, bool is_static);

  /// Frame B in frame A at a time, s since 1970, between the transforms before and after it, by the
  /// parents that frames had then. As in tf2, where a frame goes from one parent to another the
  /// earlier one holds until the later one. None: nothing joins them; a frame that moves
  /// has samples only before or only after that time, or not within `max_gap` s of it.
  std::optional<Pose> find(const std::string& a, const std::string& b, double time,
                           double max_gap = 1) const;
  /// Returns the time until which all moving transforms between the two are known, s, by the
  /// parents of that time; infinity if nothing may move. Minus infinity: nothing joins them.
  double known_until(const std::string& a, const std::string& b,
                     double time = std::numeric_limits<double>::infinity()) const;
  /// True if both belong to one tree, at any time.
  bool are_joined(const std::string& a, const std::string& b) const {
    return known_until(a, b) >= 0 || known_until(a, b, 0) >= 0;
  }
  /// True if any frame between the two moves, as far as is known.
  bool is_moving(const std::string& a, const std::string& b) const;
  std::vector<std::string> frames() const;

 private:
  struct Sample {
    std::size_t parent = 0;  // number in Link::parents
    Pose X_PC;
  };
  struct Link {
    std::vector<std::string> parents;  // all that it had
    bool is_static = false;
    ByTime<Sample> samples;
    ByTime<Sample>::const_iterator before(double time) const;  // the last one; else the first one
    const std::string& parent_at(double time) const { return parents[before(time)->second.parent]; }
    std::optional<Pose> in_parent(double time, double max_gap) const;
  };
  /// From a frame up to the first one that is above the other, too; and the other way.
  struct Chains {
    std::vector<std::string> of_a, of_b;
  };
  std::optional<Chains> chains_between(const std::string& a, const std::string& b,
                                       double time) const;
  /// From a frame up to its root at a time, with the names of those in between.
  std::vector<std::string> ancestors(const std::string& frame, double time) const;

  double kept_seconds_;
  std::map<std::string, Link> links_;  // by child, poses by time
};

}}  // namespace palpate::v0
