// Any query of a recording once more, with the settings of the run or with others.
#pragma once

#include <functional>
#include <memory>
#include <optional>
#include <string>

#include "src/run/internal/pipeline.h"
#include "src/session/lead_frames.h"
#include "src/viewer/frame_cache.h"

namespace palpate {

class Repetition {
 public:
  /// `run` must outlive it.
  explicit Repetition(RecordedRun& run);

  /// The surfaces as they were for this query: on from where they are if that is near, else anew
  /// from some frames before. False if keep_going() has become false. Errors: a frame, the
  /// settings.
  Result<bool> go_to(const RecordedQuery& query, const RunSettings& settings,
                     const std::function<bool()>& keep_going);
  /// After go_to.
  const Penetration& measure();
  const ContactQuery& query() const { return part_->query(); }
  /// The newer ones of what is measured.
  const SurfaceView& surfaces() const { return moment_.to; }
  ViewSurface surface(std::uint64_t frame_number);

  /// Begins anew with the next go_to: memory has ended in the middle of one.
  void forget() {
    timeline_.reset();
    part_.reset();
  }

  FrameCache& frames() { return frames_; }
  /// Where it is computed, if not where it was; else empty.
  const std::string& note() const { return note_; }

 private:
  Status prepare(std::size_t first, const RunSettings& settings);
  Status make_part(RunSettings settings);

  RecordedRun& run_;
  FrameCache frames_;
  ThreadPool pool_;
  std::shared_ptr<const ToolIndex> index_;
  std::unique_ptr<ContactPart> part_;
  Backend backend_ = Backend::cpu;  // of the part
  ContactOptions options_;          // likewise
  int num_spheres_ = 0;             // likewise
  std::string note_;

  std::optional<SurfaceTimeline> timeline_;
  RunSettings made_with_;             // the settings of the timeline
  std::size_t first_ = 0, next_ = 0;  // frames: pushed from, up to
  ContactRecord asked_;
  SurfaceBlend moment_;
};

}  // namespace palpate
