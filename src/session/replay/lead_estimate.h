// Depth estimate of a camera before the first frame of a part of a recording: a Kalman filter never
// forgets, so no number of earlier frames is enough to repeat it.
#pragma once

#include <cstdint>
#include <deque>
#include <optional>
#include <string>

#include "palpate/core/core.h"
#include "src/session/internal/run_messages.h"

namespace palpate { inline namespace v0 {

/// Follows the depth estimate of one camera, frame by frame, up to the first that a part may need.
class LeadEstimate {
 public:
  explicit LeadEstimate(const DepthStreamInfo& stream) : stream_(stream) {}

  /// Begins anew with these settings at the first frame of this revision.
  void begin(std::uint32_t revision, const RunSettings& settings);
  /// Takes the next frame. A missing frame spoils the estimate until it begins anew. O(pixels) with
  /// an estimate, else O(1).
  void take(const RecordedDepth& frame);

  /// True if a run that goes on with this frame, of this revision, can be repeated from here.
  bool is_known_before(std::int64_t camera_frame, std::uint32_t revision) const;
  /// True if a frame of this revision continues an estimate that earlier frames began.
  bool has_estimate(std::uint32_t revision) const {
    return averager_ != nullptr && !begins_with(revision);
  }
  /// Revision of the settings with which the estimate began.
  std::uint32_t revision() const { return revision_; }
  std::string state() const { return averager_->state(); }

 private:
  struct Beginning {
    std::uint32_t revision = 0;
    DepthAverageOptions average;
    int binning = 1;
  };

  /// True if the next frame begins an estimate anew if it is of this revision.
  bool begins_with(std::uint32_t revision) const {
    return !beginnings_.empty() && beginnings_.front().revision <= revision;
  }

  DepthStreamInfo stream_;
  std::deque<Beginning> beginnings_;  // those without a frame yet
  std::unique_ptr<DepthAverager> averager_;
  std::unique_ptr<ThreadPool> pool_;
  DepthFrame small_;
  int binning_ = 1;
  std::uint32_t revision_ = 0;
  std::int64_t last_ = -1;  // camera_frame
  bool is_whole_ = true;
};

}}  // namespace palpate::v0
