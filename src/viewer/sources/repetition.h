// Repeats any query of a recording, with the settings of the run or others.
#pragma once

#include <functional>
#include <memory>
#include <optional>
#include <string>

#include "src/run/internal/pipeline.h"
#include "src/viewer/sources/frame_cache.h"
#include "src/viewer/sources/lead_frames.h"

namespace palpate { inline namespace v0 {

class Repetition {
 public:
  /// `run` must outlive it.
  explicit Repetition(RecordedRun& run);

  /// Makes the surfaces of this query: continues from the present ones if that is near, else anew
  /// from some frames before. False if keep_going() has become false. Errors: a frame, the
  /// settings.
  Result<bool> go_to(const RecordedQuery& query, const RunSettings& settings,
                     const std::function<bool()>& keep_going);
  /// Repeats the query; call it after go_to.
  const Penetration& measure();
  const ContactQuery& query() const { return part_->query(); }
  /// Surfaces that are measured, of each camera.
  std::span<const SurfaceBlend> cameras() const { return views_.all(); }
  /// Returns the surface of the first camera.
  ViewSurface surface();

  /// Makes the next go_to begin anew, after memory ran out in the middle of one.
  void forget() {
    cameras_.clear();
    part_.reset();
  }

  /// Indexes of the frames of each camera that the query rests on, oldest first, the last one with
  /// `num_lead` before it; none: it had shown nothing yet.
  using Lead = std::vector<std::size_t>;
  std::vector<Lead> leads_of(const RecordedQuery& query, int num_lead);
  FrameCache& frames() { return frames_; }
  /// Note on the backend if it is another one than in the run; else empty.
  const std::string& note() const { return note_; }

 private:
  bool goes_on_to(const std::vector<Lead>& leads, std::size_t num_used);
  Status prepare(const std::vector<Lead>& leads, const RunSettings& settings);
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

  struct Camera {
    SurfaceTimeline timeline;
    std::int64_t first = -1, last = -1;  // camera_frame: pushed from, until; -1: none
    std::int64_t unused = -1;            // likewise: the last one made only in a small window
    double clock = 0;                    // of the last one
    std::size_t index = 0;               // likewise
  };
  std::vector<Camera> cameras_;
  RunSettings made_with_;  // the settings of the timelines
  ContactRecord query_;
  CameraViews views_{0};  // of each
};

}}  // namespace palpate::v0
