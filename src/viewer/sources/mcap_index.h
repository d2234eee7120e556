// An index of a recording: positions of its messages, without their contents.
#pragma once

#include <atomic>
#include <condition_variable>
#include <cstdint>
#include <filesystem>
#include <map>
#include <memory>
#include <mutex>
#include <string>
#include <thread>
#include <vector>

#include "src/session/internal/run_reader.h"
#include "src/viewer/sources/frame_periods.h"
#include "src/viewer/sources/recorded_run.h"

namespace palpate { inline namespace v0 {

/// A chunk of the file with the ticks and queries in it.
struct IndexedChunk {
  std::uint64_t place = 0;
  double first = 0, last = 0;  ///< s since the run began
};

struct IndexedFrame {
  std::uint64_t place = 0;  ///< of its chunk
  std::uint64_t number = 0;
  std::uint32_t camera = 0;
  std::int64_t camera_frame = 0;
  double capture_time = 0;  ///< s, monotonic
  double period = 0;        ///< s, SurfaceTimeline::period after it
};

/// Index of a recording. A thread of its own reads the file once; entries read so far can be looked
/// up meanwhile, from one thread.
class McapIndex {
 public:
  /// `path`: as of RunReader::open. Returns once the run's beginning is known, or all of it.
  /// Errors: no such file, not a recording of a run, nothing happens in it, no thread can
  /// start.
  static Result<std::unique_ptr<McapIndex>> open(const std::filesystem::path& path);
  ~McapIndex();

  const RunSetup& setup() const { return setup_; }
  /// Start of the run, s, monotonic.
  double start() const { return start_; }

  double duration() const;
  /// Settings of a revision; not null.
  std::shared_ptr<const RunSettings> settings(std::uint32_t revision) const;
  /// Notes of the run, a limited number of those that are alike; from any thread.
  std::vector<RecordedMark> marks() const;
  std::size_t num_marks() const;
  /// Description of the file's damage, or of how far it has been read; else empty.
  std::string note() const;
  std::size_t num_frames() const;
  IndexedFrame frame(std::size_t index) const;
  /// The newest frame up to this number, as index.
  std::size_t index_of(std::uint64_t number) const;
  /// Number of chunks by now, and index of the last one that begins up to `time`; else 0.
  std::size_t num_chunks() const;
  std::size_t chunk_at(double time) const;
  IndexedChunk chunk(std::size_t index) const;

 private:
  explicit McapIndex(RunReader reader);
  void read_all();
  Result<bool> read_next();
  Status take(const RunReader::Message& message);
  void add_mark(std::uint64_t wall_time, std::string text);
  void take_wall_time(std::uint64_t wall_time);

  RunReader reader_;
  const RunSetup setup_;
  const std::uint64_t file_size_;
  bool has_start_ = false;
  double start_ = 0;
  std::uint64_t wall_start_ = 0;  // ns since 1970, of the run's beginning

  mutable std::mutex mutex_;  // guards the members below
  std::condition_variable has_grown_;
  bool is_complete_ = false, is_stopping_ = false;
  std::vector<IndexedChunk> chunks_;
  std::vector<IndexedFrame> frames_;
  std::vector<FramePeriods> periods_;  // of each camera
  std::map<std::uint32_t, std::shared_ptr<const RunSettings>> settings_;
  std::vector<std::pair<std::uint64_t, std::string>> marks_;  // wall time
  std::map<std::string, std::size_t> num_alike_;              // of marks, by their words
  double duration_ = 0;
  std::string trouble_;
  std::atomic<bool> is_short_of_memory_ = false;
  std::thread thread_;
};

}}  // namespace palpate::v0
