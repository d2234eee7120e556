// The things to look at.
#pragma once

#include <filesystem>
#include <functional>
#include <memory>
#include <vector>

#include "palpate/haptics/page_handle.h"
#include "palpate/session/run.h"
#include "palpate/viewer/view_source.h"

namespace palpate {

/// A tool alone.
std::unique_ptr<ViewSource> view_tool(const Tool& tool, std::string title);

/// A recording, played, paused and searched by commands; the settings of its queries
/// can be changed to see what would have been. What is damaged is shown as far as it goes. Errors:
/// there is no recording, or nothing of it can be read.
Result<std::unique_ptr<ViewSource>> view_run(const std::filesystem::path& folder);

/// A run that goes on, live or on a simulated clock. What it hears from the publishing thread it
/// copies and goes; the server waits for the loop where a command does, and the haptic thread for
/// nobody.
class LiveView : public ViewSource {
 public:
  /// `tool` must outlive it; `streams` are those of the run's cameras. With the `handle` of the
  /// run's device, pages can hold the tool. `objects`: those of the run's settings.
  static std::unique_ptr<LiveView> create(const Tool& tool, std::vector<DepthStreamInfo> streams,
                                          std::string title,
                                          std::shared_ptr<PageHandle> handle = nullptr,
                                          std::vector<SceneObject> objects = {});
  static std::unique_ptr<LiveView> create(const Tool&&, std::vector<DepthStreamInfo>, std::string,
                                          std::shared_ptr<PageHandle> = nullptr,
                                          std::vector<SceneObject> = {}) = delete;
  /// For record_run. Without a recording: its `observer` for the loop, and `on_loop` when
  /// the loop has started and before it is stopped; the latter waits for a command that is using
  /// it.
  virtual RunMonitor& monitor() = 0;
  /// A command has asked to end the run.
  virtual bool wants_end() const noexcept = 0;
};

}  // namespace palpate
