// Frames of ROS 2 and their relative poses, from /tf and /tf_static.
#pragma once

#include <map>
#include <mutex>
#include <optional>
#include <string>

#include "src/io/internal/ros_messages.h"

namespace palpate { inline namespace v0 {

inline constexpr std::size_t kMaxFrames = 10000;  // of a tree
inline constexpr std::size_t kMaxDepth = 1000;    // of a chain to the root, as in tf2

/// Removes the slash that ROS 1 wrote before names.
inline std::string plain_frame(const std::string& frame) {
  return frame.starts_with('/') ? frame.substr(1) : frame;
}

/// The newest transform of every frame to its parent, and when it came. Any threads.
class TfTree {
 public:
  /// `time`: s, when it came, on any clock. A static one stays true.
  void add(const RosStampedTransform& transform, bool is_static, double time);
  void clear();
  /// Times are of the transforms between the two frames that are not static: none of them came
  /// before `oldest`. If all are static, `oldest` is infinity and `newest` minus infinity.
  struct Found {
    Pose X_AB;
    double oldest = 0, newest = 0;  ///< s
  };
  /// Frame B in frame A. None: nothing joins them yet.
  std::optional<Found> find(const std::string& a, const std::string& b) const;

 private:
  struct Link {
    std::string parent;
    Pose X_PC;
    bool is_static = false;
    double time = 0;  // s
  };
  const Link* parent_of(const std::string& frame) const;

  mutable std::mutex mutex_;
  std::map<std::string, Link> links_;  // by child
};

}}  // namespace palpate::v0
