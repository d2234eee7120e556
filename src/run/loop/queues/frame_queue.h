// Depth frames on a simulated clock.
#pragma once

#include <optional>
#include <utility>

#include "src/run/loop/queues/paced_source.h"

namespace palpate { inline namespace v0 {

/// Reads one frame ahead, so that the end of the stream is known while its last frame is current.
class FrameQueue {
 public:
  /// `zero`: the time stamp that is time 0; none: that of the first frame.
  FrameQueue(DepthSource& source, std::optional<double> zero) : source_(source), zero_(zero) {}

  Status start() {
    if (const Status status = read(); !status) return status;
    if (!has_upcoming_) {
      return Error{Errc::bad_input,
                   source_.info().name + " has no frames; give a source that does"};
    }
    if (!zero_) zero_ = upcoming_.timestamp;
    return Done{};
  }

  /// Moves to the newest frame that is not later than `time`; true if that is a new one.
  Result<bool> advance(double time) {
    bool fresh = false;
    while (has_upcoming_ && upcoming_.timestamp - *zero_ <= time) {
      std::swap(current_, upcoming_);
      fresh = true;
      if (const Status status = read(); !status) return status.error();
    }
    return fresh;
  }

  /// Any thread: waits for no more frames.
  void cancel() noexcept { source_.cancel(); }

  const std::string& name() const { return source_.info().name; }
  const DepthFrame& current() const { return current_; }
  /// s, on the simulated clock.
  double current_time() const { return current_.timestamp - *zero_; }
  /// True if the last frame has had its period.
  bool ended(double time) const {
    return !has_upcoming_ && time >= current_time() + 1 / source_.info().rate;
  }

 private:
  Status read() {
    const auto got = source_.read(upcoming_);
    if (!got) return got.error();
    has_upcoming_ = *got;
    return Done{};
  }

  PacedSource source_;
  DepthFrame current_, upcoming_;
  bool has_upcoming_ = false;
  std::optional<double> zero_;
};

}}  // namespace palpate::v0
