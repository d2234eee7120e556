// Positions of joints at any time, interpolated between samples.
#pragma once

#include <limits>
#include <map>
#include <string>
#include <string_view>
#include <vector>

#include "palpate/core/core.h"
#include "src/ros/internal/by_time.h"

namespace palpate { inline namespace v0 {

/// rad or m: no joint is farther away, however often it has turned.
inline constexpr double kLargestPosition = 1e6;

/// Position histories of the joints of one robot.
class JointHistory {
 public:
  /// Continuous joints are interpolated the short way.
  struct Joint {
    std::string name;
    bool is_endless = false;
  };
  /// Forgets samples older than a joint's newest one by more than `kept_seconds`: for live ones.
  explicit JointHistory(std::vector<Joint> joints,
                        double kept_seconds = std::numeric_limits<double>::infinity());

  /// Adds a sample. Other joints are ignored, and so are impossible positions: the joint is held,
  /// until it is missed. `position`: rad or m.
  void add(std::string_view joint, double time, double position);

  /// Position of a joint, by its number: interpolated between samples. After the
  /// last one it is extrapolated with the velocity of the 20 ms before. A single sample of a file
  /// stays. Error: no sample within `max_age` of that time.
  Result<double> at(std::size_t joint, double time, double max_age, bool may_stay) const;
  /// Returns the time until which all joints have samples, s; minus infinity: not all have.
  double known_until() const;
  /// "joint 'elbow' is at 1e+300 rad or m"; empty: no such position was reported. NaN is no
  /// position: it means unknown.
  std::string impossible() const;
  /// Names of joints without samples, separated by commas, and why if others have told of them.
  std::string missing() const;

 private:
  struct Impossible {
    double position = 0;
    bool is_newest = false;  // no possible position has been reported since
  };
  std::vector<Joint> joints_;
  double kept_seconds_;
  std::vector<ByTime<double>> samples_;           // positions of each joint
  std::map<std::size_t, Impossible> impossible_;  // the last one of each joint
  std::map<std::string, std::size_t, std::less<>> numbers_;
};

/// A file of text: a line with the name of the time and those of joints, then one with numbers for
/// each time, s, rad and m; commas, semicolons or blanks between them; # comments. Errors, with the
/// line: no number, too many or too few of them, time going backwards.
Status read_joint_table(std::string_view text, const std::string& name, JointHistory& history);

}}  // namespace palpate::v0
