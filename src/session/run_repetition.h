// The two sides of a run once more: frames and poses to contacts, contacts and states to
// wrenches.
#pragma once

#include <cstdint>
#include <deque>
#include <map>
#include <memory>
#include <optional>

#include "src/run/internal/pipeline.h"
#include "src/session/run_messages.h"

namespace palpate {

/// The contact side: frames to surfaces, poses to contacts.
class ContactRepetition {
 public:
  /// With `start` the first frame is that one.
  ContactRepetition(int num_threads, const std::optional<PartStart>& start)
      : pool_(std::make_unique<ThreadPool>(num_threads)),
        num_pushed_(start ? start->first_frame : 0) {}

  /// In order, the first one before all else.
  void add(const RunSetup& setup, RunParts& parts);
  void add(RecordedDepth frame) { frames_.push_back(std::move(frame)); }

  /// Whether all frames up to this one are there.
  bool has_frames_until(std::uint64_t number) const {
    return number < num_pushed_ + frames_.size();
  }
  /// The first frame that is there while one before it is not.
  bool has_gap() const {
    return !frames_.empty() && frames_.back().record.number + 1 != num_pushed_ + frames_.size();
  }

  /// What a query at the same moment and pose gives. Its frames must be there.
  ContactRecord repeat(const ContactRecord& recorded);

 private:
  struct Measuring {
    VolumeStiffness scale;
    std::unique_ptr<ContactPart> part;
  };
  void push_next();

  std::map<std::uint32_t, SurfaceTimeline> timelines_;  // by revision, from the present one on
  std::map<std::uint32_t, Measuring> measuring_;        // not yet used
  std::unique_ptr<ContactPart> part_;
  std::unique_ptr<ThreadPool> pool_;
  std::deque<RecordedDepth> frames_;  // not yet pushed
  std::uint64_t num_pushed_;
  SurfaceBlend moment_;
  double capture_time_ = 0;
};

/// The hand's side: device states and contacts to wrenches.
class TickRepetition {
 public:
  /// With `start` the hand's side goes on from there.
  TickRepetition(SafetyFilter safety, const std::optional<PartStart>& start)
      : safety_(std::make_unique<SafetyFilter>(std::move(safety))), start_(start) {}

  /// In order, the first one before all else.
  void add(const RunSetup& setup, RunParts& parts);
  TickRecord repeat(const TickRecord& recorded, const ContactRecord& contact);
  /// Whether the hand's side stands as a part says that it did.
  bool is_at(const HandMoment& moment);

 private:
  void use_couplings(std::uint32_t revision);

  std::map<std::uint32_t, std::unique_ptr<Coupling>> couplings_;  // by revision, not yet used
  std::unique_ptr<SafetyFilter> safety_;                          // of the hand to be
  std::unique_ptr<HandPart> hand_;
  std::optional<PartStart> start_;  // until the first tick
};

}  // namespace palpate
