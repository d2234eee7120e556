// The things to look at.
#pragma once

#include <filesystem>
#include <functional>
#include <memory>

#include "palpate/session/haptic_run.h"
#include "palpate/session/session.h"
#include "palpate/viewer/view_source.h"

namespace palpate {

/// A tool alone.
std::unique_ptr<ViewSource> view_tool(const Tool& tool, std::string title);

/// A recording of either kind, played, paused and searched by commands; the settings of its queries
/// can be changed to see what would have been. What is damaged is shown as far as it goes. Errors:
/// there is no recording, or nothing of it can be read.
Result<std::unique_ptr<ViewSource>> view_run(const std::filesystem::path& folder);

/// A loop that runs. What it hears from the publishing thread it copies and goes; the server waits
/// for the loop where a command does, and the haptic thread for nobody.
class LiveView : public ViewSource {
 public:
  /// `tool` must outlive it.
  static std::unique_ptr<LiveView> create(const Tool& tool, const DepthStreamInfo& stream,
                                          std::string title);
  static std::unique_ptr<LiveView> create(const Tool&&, const DepthStreamInfo&,
                                          std::string) = delete;
  /// For record_haptic_run. Without a recording: its `observer` for the loop, and `on_loop` when
  /// the loop has started and before it is stopped; the latter waits for a command that is using
  /// it.
  virtual HapticOnlooker& onlooker() = 0;
  /// A command has asked to end the run.
  virtual bool wants_end() const noexcept = 0;
};

/// A run on a simulated clock (run_session), which keeps pace with the wall clock while it is
/// looked at: no tick comes before its time.
class PathView : public ViewSource {
 public:
  /// `tool` must outlive it.
  static std::unique_ptr<PathView> create(const Tool& tool, const DepthStreamInfo& stream,
                                          std::string title);
  /// What the run tells. A tick waits here, also while the run is paused, as long as keep_going().
  virtual RunCallbacks callbacks(std::function<bool()> keep_going) = 0;
  /// The run is over, and its session no more there.
  virtual void end() = 0;
};

}  // namespace palpate
