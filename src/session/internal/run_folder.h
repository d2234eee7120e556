// The folder of a run. It appears whole or not at all: everything is written into NAME.partial-PID
// first.
#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "palpate/core/core.h"

namespace palpate { inline namespace v0 {

/// The recording inside the folder of its run, which marks it as ours.
inline constexpr const char* kRecordingFile = "recording.mcap";

/// The recording of a long run comes in parts: this one, then recording-0002.mcap and so on. Each
/// can be read by itself.
std::string part_file(int number);
/// Returns the parts in the folder of a run, in order. Empty: there is none. `error`: the folder
/// cannot be listed to its end.
std::vector<std::filesystem::path> recording_parts(const std::filesystem::path& folder,
                                                   std::error_code* error = nullptr);

/// True if `path` is `folder` or lies in it, so that replacing the folder would remove it.
bool lies_inside(const std::filesystem::path& path, const std::filesystem::path& folder);

/// Folder of a run that is being written; removed at the end unless `commit` succeeded.
class RunFolder {
 public:
  /// `target` must be new, empty, or hold an earlier run and nothing else, which `commit` will
  /// replace. Errors: anything else is in the way; the folder cannot be made.
  static Result<RunFolder> create(const std::filesystem::path& target);
  RunFolder(RunFolder&& other) noexcept;
  RunFolder& operator=(RunFolder&&) = delete;
  ~RunFolder();

  /// Folder to write to until `commit`.
  const std::filesystem::path& partial() const { return partial_; }
  /// Gives the folder its name. Files that are open stay so, and more may be added. From here to
  /// the end of this object no other program replaces the folder. Error: another one writes there.
  Status commit();
  /// Final folder.
  const std::filesystem::path& target() const { return target_; }

 private:
  RunFolder(std::filesystem::path target, std::filesystem::path partial);
  std::filesystem::path target_, partial_;  ///< `partial_` is empty once done
  int lock_ = -1;                           ///< file descriptor of the recording
};

/// Returns one self-contained HTML page that compares the reports in the folders of two runs.
/// Errors: a folder holds no run, or no report that this program can read; this build has no pages.
Result<std::string> two_runs_page(const std::filesystem::path& a, const std::filesystem::path& b);

}}  // namespace palpate::v0
