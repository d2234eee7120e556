// The two sides of a run once more: frames and poses to contacts, contacts and states to
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
#include "src/session/run_messages.h"

namespace palpate::inline v0 {

/// The contact side: frames to surfaces, poses to contacts.
class ContactRepetition {
 public:
  /// With `start` the first frames of the cameras are not those of the run. `pool` must outlive it.
  ContactRepetition(std::shared_ptr<const ToolIndex> index, ThreadPool& pool,
                    const std::optional<PartStart>& start)
      : index_(std::move(index)),
        pool_(pool),
        first_periods_(start ? start->periods : std::vector<double>()),
        has_start_(start.has_value()) {}

  /// In order, the first one before all else. Of the parts only the small ones are used: the others
  /// are made once a frame or a contact rests on them, for a message does not pay for them.
  void add(const RunSetup& setup, const RunParts& parts);
  /// False if one before it, of its camera, is not there.
  bool add(RecordedDepth frame);

  /// What a camera's estimate knew before its first frame; later it is known.
  Status add(const EstimateStart& estimate);

  /// Whether all frames that it rests on are there.
  bool has_frames_of(const ContactRecord& contact) const;
  /// Whether it rests on a frame before the first one that is there, so none will do.
  bool lacks_frame_of(const ContactRecord& contact) const;
  /// Whether a contact rests on all frames before it: an estimate has seen them.
  bool rests_on_all(const ContactRecord& contact) const;

  /// What a query at the same moment and pose gives. Its frames must be there. Errors: its settings
  /// cannot be used here.
  Result<ContactRecord> repeat(const ContactRecord& recorded);

 private:
  using Setup = std::shared_ptr<const RunSetup>;
  struct Measuring {
    ContactScale scale;
    Setup part;          // what it is made with; null: the one before goes on
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
  /// The revision of its timelines, and how they use the frames of a camera.
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
  /// With `start` the hand's side goes on from there.
  TickRepetition(SafetyFilter safety, const std::optional<PartStart>& start)
      : safety_(std::make_unique<SafetyFilter>(std::move(safety))), start_(start) {}

  /// In order, the first one before all else.
  void add(const RunSetup& setup, RunParts& parts);
  TickRecord repeat(const TickRecord& recorded, const ContactRecord& contact);
  /// Whether the hand's side stands as a part says that it did.
  bool is_at(const HandSnapshot& snapshot);

 private:
  void use_couplings(std::uint32_t revision);

  std::map<std::uint32_t, std::unique_ptr<Coupling>> couplings_;  // by revision, not yet used
  std::unique_ptr<SafetyFilter> safety_;                          // of the hand to be
  std::unique_ptr<HandPart> hand_;
  std::optional<PartStart> start_;  // until the first tick
};

}  // namespace palpate::inline v0
