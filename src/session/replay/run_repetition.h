// Repetition of the two sides of a run: frames and poses to contacts, contacts and states to
// wrenches.
#pragma once

#include <cstdint>
#include <deque>
#include <map>
#include <memory>
#include <optional>
#include <utility>

#include "src/run/internal/pipeline.h"
#include "src/session/internal/run_messages.h"

namespace palpate { inline namespace v0 {

/// The contact side: frames to surfaces, poses to contacts.
class ContactRepetition {
 public:
  /// `pool` must outlive it.
  ContactRepetition(std::shared_ptr<const ToolIndex> index, ThreadPool& pool)
      : index_(std::move(index)), pool_(pool) {}

  /// Adds settings in order, the first ones before all else. It uses only the small parts: the
  /// others are made once a frame or a contact rests on them, so that a mere message costs little.
  void add(const RunSetup& setup, const RunParts& parts);
  /// Adds a frame. False if an earlier one of its camera is missing.
  bool add(RecordedDepth frame);

  /// True if all frames that the contact rests on are there.
  bool has_frames_of(const ContactRecord& contact) const;

  /// Repeats a query at the same moment and pose. Its frames must be there. Errors: its settings
  /// cannot be used here.
  Result<ContactRecord> repeat(const ContactRecord& recorded);

 private:
  using Setup = std::shared_ptr<const RunSetup>;
  struct Measuring {
    ContactScale scale;
    Setup part;          // settings of a new part; null: the present part stays
    bool waits = false;  // for the next depth frame
  };
  struct Timeline {
    Setup setup;
    std::optional<SurfaceTimeline> surfaces;
  };
  struct Camera {
    std::map<std::uint32_t, Timeline> timelines;  // by revision, from the present one on
    std::deque<RecordedDepth> frames;             // not yet pushed
    std::int64_t newest = -1;                     // camera_frame
    CameraFrame pushed;                           // the last one
    SurfaceBlend blend;                           // after it
    std::span<const SurfaceBlend> key_frames;     // likewise
  };
  Status push_next(std::size_t camera);
  Status use_measuring(std::uint32_t revision);

  std::shared_ptr<const ToolIndex> index_;
  ThreadPool& pool_;
  std::deque<Camera> cameras_;
  CameraViews views_{0};                          // of each
  std::map<std::uint32_t, Measuring> measuring_;  // not yet used
  std::unique_ptr<ContactPart> part_;
};

/// The hand's side: device states and contacts to wrenches.
class TickRepetition {
 public:
  explicit TickRepetition(SafetyFilter safety)
      : safety_(std::make_unique<SafetyFilter>(std::move(safety))) {}

  /// Adds settings in order, the first ones before all else.
  void add(const RunSetup& setup, RunParts& parts);
  TickRecord repeat(const TickRecord& recorded, const ContactRecord& contact);

 private:
  void use_couplings(std::uint32_t revision);

  std::map<std::uint32_t, std::unique_ptr<Coupling>> couplings_;  // by revision, not yet used
  std::unique_ptr<SafetyFilter> safety_;                          // for `hand_`, until it is made
  std::unique_ptr<HandPart> hand_;
};

}}  // namespace palpate::v0
