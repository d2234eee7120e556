// Reading the recording of a run, in the order of the file.
#pragma once

#include <filesystem>
#include <memory>
#include <optional>
#include <string>
#include <string_view>

#include "palpate/tool/tool.h"
#include "src/session/run_messages.h"

namespace palpate {

class RunReader {
 public:
  /// Reads the first settings. Errors: no such file, not the recording of a run.
  static Result<RunReader> open(const std::filesystem::path& path);

  /// With `load_tools`, objects have their shapes.
  const RunSetup& setup() const { return setup_; }
  /// The tool, and the shapes of the objects. Errors: missing or damaged.
  Result<Tool> load_tools();

  struct Message {
    std::string_view topic, data;  ///< valid until the next call
    std::uint64_t time = 0;        ///< ns
  };
  /// The next one after the first settings; none at the end. Errors: name the file.
  Result<std::optional<Message>> next();
  /// The next frame or tick, whatever lies between; false at the end.
  Result<bool> next_frame(RecordedDepth& frame);
  Result<bool> next_tick(TickRecord& tick);

  bool was_cut_off() const { return reader_.was_cut_off(); }
  McapReader& file() { return reader_; }

 private:
  RunReader(std::filesystem::path path, McapReader reader, RunSetup setup);
  Error in_file(const Error& error) const;

  std::filesystem::path path_;
  McapReader reader_;
  RunSetup setup_;
};

/// Joins a frame's record with its image, which follows it.
class FrameJoiner {
 public:
  /// A frame, once its image is there. Errors: see read_frame and read_image.
  Result<std::optional<RecordedDepth>> take(std::string_view topic, std::string_view message);

 private:
  std::optional<FrameRecord> record_;
};

}  // namespace palpate
