// When a frame was captured, on this computer's clock, from the time stamps of a camera's own
// clock.
#pragma once

#include <array>
#include <cstddef>
#include <optional>

namespace palpate::inline v0 {

/// Whose clock time stamps are by: nobody's (there are none), the camera's own, this computer's.
enum class StampClock {
  none,
  cameras,  ///< of a clock of their own
  ours,     ///< say to be of this computer's, as far as that can be
  shared,   ///< of a clock declared to be synchronized with this computer's: old ones are old
};

/// A frame arrives later than it was captured by a delay that is never below a smallest one, and
/// often near it. So in the plane of time stamps and arrivals the clock of the camera is the line
/// that touches the points from below: an edge of their lower convex hull. Of every half second the
/// earliest arrival is kept, for half a minute. The smallest delay itself cannot be known: it is
/// the declared latency. Cost: some hundred operations per frame.
class CaptureClock {
 public:
  /// Returns when the frame of this time stamp was captured, s: never after it has arrived. A time
  /// stamp that does not fit by more than a second is one of a camera that has started its clock
  /// anew.
  double add(double stamp, double arrival);
  void reset() { *this = CaptureClock(); }

  /// How much faster than ours the camera's clock goes, 1 = twice as fast.
  double drift() const { return -slope_; }
  int num_restarts() const { return num_restarts_; }

 private:
  static constexpr double kBinSeconds = 0.5, kLongestJump = 1;
  static constexpr std::size_t kNumBins = 64;
  static constexpr double kShortestBase = 5;  // s, below it drift is not estimated
  static constexpr double kLargestDrift = 1e-3;

  struct Point {
    double x = 0, y = 0;  // s: time stamp since the first one, arrival - time stamp
  };
  void keep(const Point& point);
  void fit();

  std::array<Point, kNumBins> bins_ = {};  // in the order of time
  std::size_t num_bins_ = 0;
  double first_stamp_ = 0, bin_end_ = 0, slope_ = 0, offset_ = 0;
  int num_restarts_ = 0;
  bool has_begun_ = false;
};

}  // namespace palpate::inline v0
