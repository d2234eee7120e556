// Repetition of the two sides of a run: frames and poses to contacts, contacts and states to
// wrenches.
#pragma once

#include <cstdint>
#include <deque>
#include <map>
#include <memory>
#include <optional>
#include <utility>
#include <vector>

#include "src/run/internal/pipeline.h"
#include "src/session/internal/run_messages.h"

namespace palpate { inline namespace v0 {

/// The contact side: frames to surfaces, poses to contacts.
class ContactRepetition {
 public:
  /// `start`: the first frames of the cameras are not those of the run. `pool` must outlive it.
  ContactRepetition(std::shared_ptr<const ToolIndex> index, ThreadPool& pool,
                    const std::optional<PartStart>& start)
      : index_(std::move(index)),
        pool_(pool),
        first_periods_(start ? start->periods : std::vector<double>()),
        has_start_(start.has_value()) {}

  /// Adds settings in order, the first ones before all else. It uses only the small parts: the
  /// others are made once a frame or a contact rests on them, so that a mere message costs little.
  void add(const RunSetup& setup, const RunParts& parts);
  /// Adds a frame. False if an earlier one of its camera is missing.
  bool add(RecordedDepth frame);

  /// Sets the state of a camera's estimate before its first frame; later it is known.
  Status add(const EstimateStart& estimate);

  /// True if all frames that the contact rests on are there.
  bool has_frames_of(const ContactRecord& contact) const;
  /// True if it rests on a frame before the first one that is there: no later frame will do.
  bool lacks_frame_of(const ContactRecord& contact) const;
  /// True if it rests on all frames before it, as an estimate has used them.
  bool rests_on_all(const ContactRecord& contact) const;

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
    double first_period = 0;  // s; 0: that of its settings
    std::optional<SurfaceTimeline> surfaces;
  };
  struct Camera {
    std::map<std::uint32_t, Timeline> timelines;        // by revision, from the present one on
    std::deque<RecordedDepth> frames;                   // not yet pushed
    std::int64_t first = -1, newest = -1, pushed = -1;  // camera_frame: there; pushed last
    std::uint32_t first_revision = 0;                   // of that frame
    double capture_time = 0;                            // of that one
    std::span<const SurfaceBlend> key_frames;           // and after it
  };
  static Result<SurfaceTimeline*> made(Timeline& timeline, std::size_t camera);
  Status push_next(std::size_t camera);
  Status use_measuring(std::uint32_t revision);
  /// Returns the revision of its timelines and their time options.
  const std::pair<const std::uint32_t, TimeOptions>& time_of(const ContactRecord& contact) const;

  std::shared_ptr<const ToolIndex> index_;
  ThreadPool& pool_;
  std::vector<double> first_periods_;  // s, of cameras whose frames do not begin here
  std::deque<Camera> cameras_;
  std::map<std::uint32_t, TimeOptions> times_;    // of timelines by revision, as above
  CameraViews views_{0};                          // of each
  std::map<std::uint32_t, Measuring> measuring_;  // not yet used
  std::unique_ptr<ContactPart> part_;
  bool has_start_;
};

/// The hand's side: device states and contacts to wrenches.
class TickRepetition {
 public:
  /// `start`: the hand's side goes on from there.
  TickRepetition(SafetyFilter safety, const std::optional<PartStart>& start)
      : safety_(std::make_unique<SafetyFilter>(std::move(safety))), start_(start) {}

  /// Adds settings in order, the first ones before all else.
  void add(const RunSetup& setup, RunParts& parts);
  TickRecord repeat(const TickRecord& recorded, const ContactRecord& contact);
  /// True if the state of the hand's side is that of a snapshot, to the bit.
  bool is_at(const HandSnapshot& snapshot);

 private:
  void use_couplings(std::uint32_t revision);

  std::map<std::uint32_t, std::unique_ptr<Coupling>> couplings_;  // by revision, not yet used
  std::unique_ptr<SafetyFilter> safety_;                          // for `hand_`, until it is made
  std::unique_ptr<HandPart> hand_;
  std::optional<PartStart> start_;  // until the first tick
};

}}  // namespace palpate::v0
