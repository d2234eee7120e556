// All that a run depends on, in files: enough to repeat it bit for bit.
//
//   recording.json   format, settings, camera, and length and checksum of every other file
//   tool.palp        the tool
//   object-000.palp  the objects, if any; their poses are among the settings
//   path.txt         the pose of every tick (TUM format, exact decimals)
//   depth.txt        time stamp and file of every frame that became current (TUM layout)
//   depth/*.png      these frames
#pragma once

#include <filesystem>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include "palpate/core/result.h"
#include "palpate/session/session.h"

namespace palpate {

/// Collects a recording while a run goes on.
class Recorder {
 public:
  /// Starts the recording in `folder`, which must not exist yet.
  static Result<Recorder> create(const std::filesystem::path& folder, const Tool& tool,
                                 std::span<const SceneObject> objects = {});

  /// Stores a frame; for RunCallbacks::on_frame.
  Status add_frame(std::size_t index, double time, const DepthFrame& frame);
  /// Stores poses and manifest. Until then, load_recording refuses the folder.
  Status finish(const RunLog& log);

 private:
  explicit Recorder(std::filesystem::path folder) : folder_(std::move(folder)) {}
  Status add_tool(const Tool& tool, const std::string& name);
  Status add_file(const std::string& name);

  struct FileEntry {
    std::string name;
    std::size_t bytes = 0;
    std::string checksum;
  };
  std::filesystem::path folder_;
  std::string frame_list_;
  std::vector<FileEntry> files_;
};

/// A recording that was read back.
struct Recording {
  Tool tool;
  RunSettings settings;
  std::vector<Pose> poses;  ///< of each tick
  std::unique_ptr<DepthSource> frames;
};

/// `folder` is the recording itself. Errors: absent, unfinished, newer format, a file that is
/// missing or differs from its checksum, values out of range.
Result<Recording> load_recording(const std::filesystem::path& folder);

}  // namespace palpate
