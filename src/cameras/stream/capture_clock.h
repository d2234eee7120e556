// When a frame was captured, on this computer's clock, from the time stamps of a camera's own
// clock.
#pragma once

#include <array>
#include <cstddef>
#include <limits>

namespace palpate { inline namespace v0 {

/// Clock of the time stamps: none (there are no stamps), the camera's own, or this computer's.
enum class StampClock {
  none,
  cameras,  ///< of a clock of their own
  ours,     ///< said to be this computer's, and believed if plausible
  shared,   ///< of a clock declared to be synchronized with this computer's: old ones are old
};

/// Detects time stamps that are not in order, and clocks that were set back.
class StampOrder {
 public:
  enum class Step {
    newer,
    older,     ///< not after the newest one: a frame that was overtaken, or is sent again
    set_back,  ///< the clock was set back: by more than a second, or it goes on from there
  };
  /// `arrival`: s, monotonic.
  Step add(double stamp, double arrival);

 private:
  static constexpr double kLongestBack = 1;  // s that a frame may be overtaken by
  static constexpr int kNumOlder = 3;        // in a row: a clock goes on, if they come at its pace
  static constexpr double kPace = 0.5;       // of the time between their arrivals

  struct Frame {
    double stamp = 0, arrival = 0;
  };
  double newest_ = -std::numeric_limits<double>::infinity();
  Frame first_older_;
  double last_older_ = 0;  // its stamp
  int num_older_ = 0;      // in a row, each after the one before
};

/// A frame arrives later than it was captured by a delay that is never below a smallest one, and
/// often near it. So in the plane of time stamps and arrivals the clock of the camera is the line
/// that touches the points from below: an edge of their lower convex hull. Of every half second the
/// earliest arrival is kept, for half a minute. The smallest delay itself cannot be known: it is
/// the declared latency. Cost: some hundred operations per frame.
///
/// A delay that grows faster than clocks drift is lateness, however long it lasts, as long as time
/// stamps go on. A clock that was set shows otherwise: backwards by the order of its time stamps,
/// forwards by frames that would have arrived before they were captured.
class CaptureClock {
 public:
  /// Returns when the frame of this time stamp was captured, s: never after it has arrived.
  double add(double stamp, double arrival);
  void reset() { *this = CaptureClock(); }

  /// Rate of the camera's clock relative to ours, minus 1: 1 = twice as fast.
  double drift() const { return -slope_; }
  /// Number of times that it was set back, or forward by more than a second.
  int num_restarts() const { return num_restarts_; }

 private:
  static constexpr double kBinSeconds = 0.5, kLongestJump = 1;
  static constexpr std::size_t kNumBins = 64;
  static constexpr double kShortestBase = 5;  // s, below it drift is not estimated
  static constexpr double kLargestDrift = 1e-3;
  static constexpr double kEarly = 0.05;   // s: before that, one frame alone has a wrong time stamp
  static constexpr double kConfirmed = 1;  // s from one early frame to the next

  struct Point {
    double x = 0, y = 0;  // s: time stamp since the first one, arrival - time stamp
  };
  void begin(double stamp);
  void keep(const Point& point);
  void fit();
  void follow(double x);

  StampOrder order_;
  std::array<Point, kNumBins> bins_ = {};  // in the order of time
  std::size_t num_bins_ = 0;
  double first_stamp_ = 0, bin_end_ = 0, slope_ = 0, offset_ = 0;
  Point least_;  // the smallest delay at the newest stamp, which grows as clocks drift at most
  double last_early_ = -std::numeric_limits<double>::infinity();  // s, an arrival
  int num_restarts_ = 0;
  bool has_begun_ = false;
};

}}  // namespace palpate::v0
