// Recordings as MCAP files (https://mcap.dev), the open container that robotics tools read:
// messages with time stamps on named channels, whose schemas travel with them.
//
// A file that was cut off (power, kill -9) is readable up to its last whole chunk.
#pragma once

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "palpate/core/core.h"

namespace palpate { inline namespace v0 {

/// Channel of messages of ROS 2 (CDR), described by their `.msg` text.
struct McapChannel {
  std::string topic;        ///< e.g. "/tick"
  std::string schema_name;  ///< e.g. "palpate_msgs/msg/Tick"
  std::string schema;       ///< that text, and those of all types in it; readers leave it empty
  std::string encoding = "cdr";  ///< of its messages; writers write CDR
};

struct McapOptions {
  std::size_t chunk_bytes = 2 << 20;  ///< a chunk is written when it is so large ...
  double chunk_seconds = 0.5;         ///< ... or its first message so old
};

/// Appends, with the profile "ros2" and chunks compressed by Zstandard. Not for the haptic thread:
/// writing may wait for memory, and `finish` for the disk.
class McapWriter {
 public:
  /// Errors: the file cannot be made.
  static Result<McapWriter> create(const std::filesystem::path& path,
                                   const McapOptions& options = {});
  McapWriter(McapWriter&&) noexcept;
  McapWriter& operator=(McapWriter&&) noexcept;
  ~McapWriter();  ///< `end`s as well as it can

  /// Writes a whole file into the recording. Before the first message. Error: as `write`.
  Status attach(std::string_view name, std::string_view media_type, std::string_view contents);
  /// Returns the number that messages of this channel are written with.
  std::uint16_t add_channel(const McapChannel& channel);
  /// `time` in nanoseconds; messages come roughly in order of time. Error: the disk is full or
  /// broken; what was written before stays readable, and every later call gives the same error.
  Status write(std::uint16_t channel, std::uint64_t time, std::string_view message);
  /// Writes what is still in memory: it outlives the program, and is on the disk soon after.
  Status flush();
  /// Writes the rest, summary and index, likewise. No writing after that.
  Status end();
  /// True while written bytes are on their way to the disk.
  bool waits_for_disk() const;
  /// `end`, and waits until all is on the disk.
  Status finish();
  std::uint64_t bytes_written() const;
  /// Without bytes that may be lost because the disk failed.
  std::uint64_t bytes_kept() const;
  /// Bytes that have reached the disk.
  std::uint64_t bytes_on_disk() const;

 private:
  struct Impl;
  explicit McapWriter(std::unique_ptr<Impl> impl);
  std::unique_ptr<Impl> impl_;
};

struct McapMessage {
  std::uint16_t channel = 0;
  std::uint64_t time = 0;  ///< ns
  std::string_view data;   ///< valid until the next call
};

/// Reads in the order of the file, one chunk in memory at a time, compressed by Zstandard, LZ4 (if
/// liblz4 is there) or not at all.
class McapReader {
 public:
  /// Errors: no such file, not an MCAP file.
  static Result<McapReader> open(const std::filesystem::path& path);
  McapReader(McapReader&&) noexcept;
  McapReader& operator=(McapReader&&) noexcept;
  ~McapReader();

  /// The next message, or nullopt at the end, also at that of a file that was cut off
  /// (`was_cut_off`). Errors: a damaged chunk (checksum), with its place in the file; a message of
  /// a channel that was not met before; the disk cannot read on.
  Result<std::optional<McapMessage>> next();
  /// Returns the channels met so far.
  const std::map<std::uint16_t, McapChannel>& channels() const;
  bool was_cut_off() const;

  /// A file inside the recording. Errors: there is none of that name, or it is damaged.
  Result<std::string> attachment(std::string_view name);

  /// Returns where the chunk of the last message begins in the file; 0 before the first one.
  std::uint64_t chunk_place() const;
  /// Makes the first message of a chunk the next one. `chunk_place`: as returned for this file.
  void seek(std::uint64_t chunk_place);

 private:
  struct Impl;
  explicit McapReader(std::unique_ptr<Impl> impl);
  std::unique_ptr<Impl> impl_;
};

}}  // namespace palpate::v0
