// A recorded run of a hand on a visible scene, and its replay by each method: equivalent to
// palpate replay RUN -o OUT --method METHOD.
#pragma once

#include <filesystem>
#include <functional>
#include <memory>
#include <vector>

#include "eval/context.h"
#include "palpate/contact/contact.h"
#include "palpate/run/run_loop.h"
#include "palpate/tool/tool.h"

namespace palpate::eval {

/// Makes a source of frames in memory, the first at time 0. Both have to outlive it.
std::unique_ptr<DepthSource> frames_in_memory(const DepthStreamInfo& stream,
                                              const std::vector<DepthFrame>& frames);

class RecordedRun {
 public:
  /// Records a hand at these poses, a thousand a second, without forces, in front of one depth
  /// frame. Kept in its own folder, which is removed with the object. Errors: as of record_run.
  static Result<RecordedRun> record(const Tool& tool, const FirstFrame& picture,
                                    const std::vector<Pose>& X_WT);

  /// Records a simulated hand that follows a path and receives the force of the field (10 N of a
  /// tool wholly inside, as in the thesis' plots), on a simulated device at 1 kHz, in front of
  /// frames that arrive at their times. As long as the frames last. `X_WT`: the path, s after the
  /// first frame. Errors: as of record_run.
  static Result<RecordedRun> touch(const Tool& tool, const DepthStreamInfo& stream,
                                   const std::vector<DepthFrame>& frames,
                                   const std::function<Pose(double time)>& X_WT);

  /// Returns the measurements by this method at the recorded poses, tick by tick. Repeats the run
  /// and takes as long.
  Result<std::vector<TickRecord>> by(const ContactOptions& options) const;

  /// Repeats the run as recorded. Returns empty if bit-identical, else the first difference.
  Result<std::string> repeat() const;

 private:
  /// Removed with its last owner.
  using Folder = std::shared_ptr<const std::filesystem::path>;
  explicit RecordedRun(Folder folder) : folder_(std::move(folder)) {}
  static Result<RecordedRun> record(const Tool& tool, DepthSource& source, HapticDevice& device,
                                    const RunSettings& settings, bool ends_with_frames);
  Folder folder_;
};

/// Force at a tool that is wholly inside, N, as in the thesis' plots.
inline constexpr double kFullForce = 10;

}  // namespace palpate::eval
