// A run that the program itself records, a hand on something seen, and what each method makes of
// the same run: what palpate replay RUN -o OUT --method METHOD does.
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

/// Frames that are there already, the first at time 0. Both have to outlive it.
std::unique_ptr<DepthSource> frames_in_memory(const DepthStreamInfo& stream,
                                              const std::vector<DepthFrame>& frames);

class RecordedRun {
 public:
  /// A hand that is at these poses, a thousand a second, and feels nothing, in front of one depth
  /// frame. Kept in a folder of its own that goes with the object. Errors: as of record_run.
  static Result<RecordedRun> record(const Tool& tool, const FirstFrame& picture,
                                    const std::vector<Pose>& X_WT);

  /// A simulated hand that means to follow a path and feels what the field measures (10 N of a tool
  /// wholly inside, as in the thesis' plots), on a simulated device at 1 kHz, in front of frames
  /// that arrive at their times. As long as the frames last. `X_WT`: the path, s after the first
  /// frame. Errors: as of record_run.
  static Result<RecordedRun> touch(const Tool& tool, const DepthStreamInfo& stream,
                                   const std::vector<DepthFrame>& frames,
                                   const std::function<Pose(double time)>& X_WT);

  /// Returns what the tool measures by this method wherever the recorded hand was, tick by tick.
  /// Repeats the run and takes as long.
  Result<std::vector<TickRecord>> by(const ContactOptions& options) const;

  /// Repeats it as it was recorded. Empty: the same to the bit; else the first difference.
  Result<std::string> repeat() const;

 private:
  /// Removed with the last run that has it.
  using Folder = std::shared_ptr<const std::filesystem::path>;
  explicit RecordedRun(Folder folder) : folder_(std::move(folder)) {}
  static Result<RecordedRun> record(const Tool& tool, DepthSource& source, HapticDevice& device,
                                    const RunSettings& settings, bool ends_with_frames);
  Folder folder_;
};

/// Force at a tool that is wholly inside, N, as in the thesis' plots.
inline constexpr double kFullForce = 10;

}  // namespace palpate::eval
