// Recordings of other programs, message by message: MCAP, bags of ROS 1 (.bag), and those of ROS 2
// that are SQLite databases (.db3).
#pragma once

#include <cstdint>
#include <filesystem>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "src/io/internal/mcap_file.h"

namespace palpate { inline namespace v0 {

/// Messages in the order of the file, one chunk in memory at a time. Whatever the file, schemas are
/// named as in ROS 2 ("sensor_msgs/msg/Image") and messages are in CDR, unpacked; those of a type
/// of ROS 1 that is not known here, and those that are damaged in themselves, are empty.
class BagReader {
 public:
  /// Opens a file by its first bytes, or the files of a folder one after the other, if they are
  /// parts of one recording (by rosbag2's metadata.yaml, which may be given, too, or by their
  /// numbers). Errors: no such file, none of these formats, a missing library (SQLite; see
  /// bags/unpack.h).
  static Result<std::unique_ptr<BagReader>> open(const std::filesystem::path& path);
  virtual ~BagReader() = default;

  /// The next message, or nullopt at the end, also at that of a file that was cut off
  /// (`was_cut_off`). Errors: the file is damaged or cannot be read, with the place.
  virtual Result<std::optional<McapMessage>> next() = 0;
  /// Returns the channels met so far.
  virtual const std::map<std::uint16_t, McapChannel>& channels() const = 0;
  virtual bool was_cut_off() const = 0;
  /// Says which parts of the recording are missing, or empty and left out, by their names.
  virtual const std::vector<std::string>& notes() const = 0;
  /// Makes the first message the next one. Chunks that took long to unpack are cached. Errors: as
  /// of `open`.
  virtual Status rewind() = 0;
};

/// Returns the first file of the recording of which this is a later part, by rosbag2's
/// metadata.yaml beside it; else empty. It holds messages sent once, such as static transforms.
std::filesystem::path first_part_of(const std::filesystem::path& file);

}}  // namespace palpate::v0
