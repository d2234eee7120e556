// What the estimate of a camera's depth knew before the first frame of a part of a recording: a
// Kalman filter never forgets, so no number of frames before is enough to repeat it.
#pragma once

#include <cstdint>
#include <deque>
#include <optional>
#include <string>

#include "palpate/core/core.h"
#include "src/session/run_messages.h"

namespace palpate::inline v0 {

/// Follows a run, one camera's frames one after the other, as far as no part needs them any more.
class LeadEstimate {
 public:
  explicit LeadEstimate(const DepthStreamInfo& stream) : stream_(stream) {}

  /// From this revision on surfaces are made anew with these settings.
  void begin(std::uint32_t revision, const RunSettings& settings);
  /// The next frame. A missing frame spoils the estimate until it
  /// begins anew. O(pixels) with an estimate, else O(1).
  void take(const RecordedDepth& frame);

  /// Whether a run that goes on with this frame, of this revision, can be repeated from here.
  bool is_known_before(std::int64_t camera_frame, std::uint32_t revision) const;
  /// Whether a frame of this revision goes on with an estimate that others have begun.
  bool has_estimate(std::uint32_t revision) const {
    return averager_ != nullptr && !begins_with(revision);
  }
  /// Of the settings with which it began.
  std::uint32_t revision() const { return revision_; }
  std::string state() const { return averager_->state(); }

 private:
  struct Beginning {
    std::uint32_t revision = 0;
    DepthAverageOptions average;
    int binning = 1;
  };

  /// Whether surfaces are made anew with the next frame if it is of this revision.
  bool begins_with(std::uint32_t revision) const {
    return !beginnings_.empty() && beginnings_.front().revision <= revision;
  }

  DepthStreamInfo stream_;
  std::deque<Beginning> beginnings_;  // that no frame was of yet
  std::unique_ptr<DepthAverager> averager_;
  std::unique_ptr<ThreadPool> pool_;
  DepthFrame small_;
  int binning_ = 1;
  std::uint32_t revision_ = 0;
  std::int64_t last_ = -1;  // camera_frame
  bool is_whole_ = true;
};

}  // namespace palpate::inline v0
