// Records a run while it lasts: MCAP files that ROS 2 tools, Foxglove and `palpate replay`
// read.
#pragma once

#include <deque>
#include <filesystem>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <vector>

#include "palpate/session/run.h"
#include "palpate/tool/tool.h"
#include "src/session/internal/run_messages.h"

namespace palpate { inline namespace v0 {

// Coordinate frames, as ROS names them: the world, the base of the device, its handle, the tool.
inline constexpr const char* kWorldFrame = "world";
inline constexpr const char* kBaseFrame = "base";
inline constexpr const char* kHandFrame = "hand";
inline constexpr const char* kToolFrame = "tool";

/// Returns the name of a camera's coordinate frame in recordings: "camera", "camera_2", ...
std::string camera_frame(std::size_t camera);

/// Records a run, called by the publishing thread of a loop, which in live runs never waits for the
/// disk. If a file can no longer be written, or the disk is nearly full, it pauses with a note;
/// everything else goes on. It resumes in another part once there is space again.
class RunRecorder {
 public:
  /// `path`: the first file. `is_simulated`: times are not monotonic ones, but s since
  /// setup.time_origin. `tool` must outlive it. Errors: the file cannot be made.
  static Result<RunRecorder> create(const std::filesystem::path& path, const Tool& tool,
                                    const RunSetup& setup, bool is_simulated,
                                    const RecordingOptions& options = {});

  /// Sets the new name of the folder. Any thread.
  void has_moved_to(const std::filesystem::path& folder);

  /// Adds settings of a later revision; the first ones are those of the setup.
  void add_settings(std::uint32_t revision, const RunSettings& settings);
  void add_frame(const FrameRecord& record, const DepthFrame& frame);
  void add_contact(const ContactRecord& contact);
  void add_tick(const TickRecord& tick);
  void add_note(std::string_view text);
  /// Adds a note at a time, s, monotonic.
  void add_note(std::string_view text, double time);

  /// Completes the file; nothing can be recorded any more.
  void end();
  /// True if `finish` has to wait.
  bool waits_for_disk() const;
  /// `end`, and waits until all is on the disk.
  void finish();
  /// Description of missing records and their cause; else empty.
  const std::string& trouble() const { return trouble_; }
  /// Notes for the user since the last call.
  std::vector<std::string> take_notes() { return std::exchange(notes_, {}); }

 private:
  /// The first `bytes` of a file hold all ticks until `time`, s.
  struct Mark {
    std::uint64_t bytes;
    double time;
  };
  struct Part {
    std::filesystem::path file;             // its name in the folder
    std::deque<Mark> marks;                 // of each time that something was written, the first
                                            // the last one that the disk has for sure
    double end = 0;                         // s, of its last tick
    std::uint64_t bytes = 0;                // once it is whole
    std::optional<McapWriter> ending = {};  // being flushed to the disk

    double kept_until(const McapWriter& writer) const;
    std::string gap(const McapWriter& writer) const;
  };
  struct Channels {
    std::uint16_t part, settings, frame, contact, tick, note, transforms, statics, tool_wrench,
        hand_wrench, marker;
    struct Camera {
      std::uint16_t depth, points, info;
      std::uint16_t flow = 0;  // of cameras that have one
    };
    std::vector<Camera> cameras;
  };
  RunRecorder(const std::filesystem::path& path, const Tool& tool, const RunSetup& setup,
              bool is_simulated, const RecordingOptions& options);
  Result<McapWriter> make_file(const std::filesystem::path& path);
  Status begin(std::optional<std::uint64_t> first_tick);
  Status begin_part(std::uint64_t first_tick);
  void change_parts(std::uint64_t next_tick);
  std::uint64_t wall_time(double time);
  void write(std::uint16_t channel, std::uint64_t time, std::string_view message);
  void add_transforms(const TickRecord& tick, std::uint64_t time);
  void add_camera_pose(std::uint32_t camera, const Pose& X_WC, std::uint64_t time);
  void pause(const Error& error);
  void remove_old();
  void add_mark(Part& part, const McapWriter& writer) const;
  void end_part(Part& part, McapWriter writer);
  void take_ended(bool waits);
  void add_trouble(const std::string& text);
  std::filesystem::path folder() const;

  const Tool* tool_;
  RecordingOptions options_;
  bool is_simulated_;
  struct Place {
    std::mutex mutex;
    std::filesystem::path folder;
  };
  std::unique_ptr<Place> place_;
  std::optional<McapWriter> writer_;  // nullopt: paused
  Channels channels_{};
  RunSetup setup_;  // with the newest settings
  Vec3d center_of_mass_T_;
  double wall_offset_ = 0;       // s from the run's clock to the time since 1970
  std::uint64_t last_time_ = 0;  // ns since 1970
  std::uint64_t next_transforms_ = 0;
  struct Camera {
    std::uint64_t next_points = 0;
    std::optional<Pose> X_WC;  // in the present part
  };
  std::vector<Camera> cameras_;
  // Parts.
  std::deque<Part> parts_;  // that are there; the last is being written
  int num_parts_ = 1, num_troubles_ = 0;
  double time_ = 0, part_start_ = 0;  // s: of the last tick, of the part
  double next_try_ = 0, patience_ = 1;
  std::string gap_, reason_;  // of the pause
  bool has_ended_ = false, has_told_no_part_ = false;
  std::string trouble_;
  std::vector<std::string> notes_;
};

}}  // namespace palpate::v0
