// Reading the recording of a run, in the order of the file.
#pragma once

#include <filesystem>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "palpate/tool/tool.h"
#include "src/session/internal/run_messages.h"

namespace palpate { inline namespace v0 {

class RunReader {
 public:
  /// `path`: the folder of a run, with all parts of its recording, or one of these files. Reads the
  /// first settings. Errors: no such file, not the recording of a run.
  static Result<RunReader> open(const std::filesystem::path& path);

  /// Error: the first file is not the first part of its run, so the run cannot be repeated.
  Status begins_with_run() const;

  /// Setup of the run; objects have their shapes after `load_tools`.
  const RunSetup& setup() const { return setup_; }
  /// Loads the tool and the shapes of the objects. Errors: missing or damaged.
  Result<Tool> load_tools();

  struct Message {
    std::string_view topic, data;  ///< valid until the next call
    std::uint64_t time = 0;        ///< ns
  };
  /// Returns the next message after the first settings; none at the end of the last part. Errors:
  /// name the file.
  Result<std::optional<Message>> next();
  /// Reads the next frame or tick, whatever lies between; false at the end. `on_frame` is called
  /// with frames on the way.
  Result<bool> next_frame(RecordedDepth& frame);
  Result<bool> next_tick(TickRecord& tick,
                         const std::function<void(const FrameRecord&)>& on_frame = {});

  /// True if the last part was cut off.
  bool was_cut_off() const { return reader_.was_cut_off(); }

  /// Part and start of the chunk of the last message, as one number; 0 before the first one.
  std::uint64_t chunk_place() const;
  /// Moves to the first message of the chunk at a place. Error: the part is gone.
  Status seek(std::uint64_t chunk_place);
  /// Sizes of all parts, bytes; and of the data before a place.
  std::uint64_t num_bytes() const;
  std::uint64_t num_bytes_before(std::uint64_t chunk_place) const;

 private:
  RunReader(std::vector<std::filesystem::path> parts, McapReader reader, RunSetup setup);
  const std::filesystem::path& path() const { return parts_[part_]; }
  Status open_part(std::size_t part);
  Error in_file(const Error& error) const;

  std::vector<std::filesystem::path> parts_;
  std::size_t part_ = 0;  // index of the part being read
  McapReader reader_;
  RunSetup setup_;
  std::optional<PartStart> start_;  // of the first file
};

/// Reports the share that a reader has read, once for each chunk of the recording.
class ReadShare {
 public:
  ReadShare(const RunReader& reader, std::function<void(double share)> tell)
      : num_bytes_(static_cast<double>(reader.num_bytes())), tell_(std::move(tell)) {}

  void look(const RunReader& reader) {
    const std::uint64_t place = reader.chunk_place();
    if (!tell_ || place == std::exchange(place_, place)) return;
    const auto before = static_cast<double>(reader.num_bytes_before(place));
    if (first_ < 0) first_ = before;
    tell_((before - first_) / (num_bytes_ - first_));
  }

 private:
  double num_bytes_, first_ = -1;  // before the first chunk there are tools
  std::function<void(double share)> tell_;
  std::uint64_t place_ = 0;
};

/// Joins a frame's record with its optical flow, if it has one, and its image, which follow it.
class FrameJoiner {
 public:
  /// Joins frames of cameras of these streams, which stay where they are.
  explicit FrameJoiner(std::span<const DepthStreamInfo> streams) : streams_(streams) {}

  /// A frame, once its image is there. Errors: see read_frame and read_image; a camera that the run
  /// has not; an image of another size than its camera's.
  Result<std::optional<RecordedDepth>> take(std::string_view topic, std::string_view message);

 private:
  std::span<const DepthStreamInfo> streams_;
  std::optional<FrameRecord> record_;
  std::string depth_topic_, flow_topic_;  // of its camera
  std::vector<float> flow_;
};

}}  // namespace palpate::v0
