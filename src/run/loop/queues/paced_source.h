// Paces the frames of any source in real time.
#pragma once

#include <algorithm>
#include <atomic>
#include <cstdint>
#include <string>

#include "palpate/cloud/depth_source.h"
#include "src/cloud/internal/frame_limits.h"
#include "src/core/internal/message_text.h"

namespace palpate { inline namespace v0 {

/// Checks the frames of a source and says when each of them is to be used: as far apart as their
/// time stamps. A source that is slower than its time stamps shifts all that follows, so that the
/// age of a frame is not counted twice.
class PacedSource {
 public:
  explicit PacedSource(DepthSource& source) : source_(source) {}

  const DepthStreamInfo& info() const { return source_.info(); }
  void cancel() noexcept { source_.cancel(); }

  /// As DepthSource::next. Errors also: a frame of another size, one that is not later, one with a
  /// unit or a time stamp that cannot be.
  Result<bool> read(DepthFrame& frame) {
    auto got = source_.next(frame);
    if (!got || !*got) return got;
    const DepthStreamInfo& stream = info();
    if (frame.width != stream.width || frame.height != stream.height ||
        frame.pixels.size() !=
            static_cast<std::size_t>(stream.width) * static_cast<std::size_t>(stream.height)) {
      return bad("has another size than the stream; all frames must have one size");
    }
    if (!frame.flow.empty() && frame.flow.size() != 2 * frame.pixels.size()) {
      return bad("has an optical flow of another size; it has two numbers for each pixel");
    }
    if (!is_depth_unit(frame.unit)) {
      return bad("has a unit of " + number_text(frame.unit) +
                 " m per count; it must be from 0 to 1 m");
    }
    if (!is_in_seconds(frame.timestamp)) {
      return bad("has a time stamp of " + number_text(frame.timestamp) + " s; give seconds");
    }
    if (num_read_ > 0 && !(frame.timestamp > last_stamp_)) {
      return bad("is not later than the one before; sort the frames by their time stamps");
    }
    last_stamp_ = frame.timestamp;
    ++num_read_;
    return got;
  }

  /// When the frame that has just been read is captured, s on the clock of `now`: not before `now`,
  /// but of a live stream not after it.
  double capture_time(const DepthFrame& frame, double now) {
    if (info().is_live) return std::min(frame.timestamp, now);
    const double late = now - (frame.timestamp + offset_);
    if (num_read_ == 1 || late > 0) offset_ = now - frame.timestamp;
    if (num_read_ > 1 && late > kLate / info().rate) num_late_.fetch_add(1);
    return frame.timestamp + offset_;
  }
  /// Frames that came too late for their time stamps; any thread.
  std::uint64_t num_late() const noexcept { return num_late_.load(); }

 private:
  static constexpr double kLate = 0.2;  // of the time between two frames

  Error bad(const std::string& what) const {
    return {Errc::bad_input, info().name + ": frame " + std::to_string(num_read_) + " " + what};
  }

  DepthSource& source_;
  double offset_ = 0, last_stamp_ = 0;
  int num_read_ = 0;
  std::atomic<std::uint64_t> num_late_ = 0;
};

}}  // namespace palpate::v0
