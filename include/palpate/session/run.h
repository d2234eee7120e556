// A run with everything that is kept of it, and its repetition.
//
//   recording.mcap  (and recording-0002.mcap ... of long runs) settings, tool, depth frames,
//   contacts, ticks and notes: whole up to the last
//                   half second even if the program is killed; ROS 2 tools and Foxglove read it
//   wrench.csv      one line per tick, units in its first line; no compute times
//   summary.json    settings, counts, peaks, percentiles of every stage, faults
//   report.html     the same for humans, with plots and the deepest moment in 3-D; not in a build
//                   without pages
#pragma once

#include <array>
#include <filesystem>
#include <functional>
#include <limits>
#include <mutex>
#include <optional>
#include <string>
#include <vector>

#include "palpate/math/geometry.h"
#include "palpate/run/run_loop.h"
#include "palpate/settings/setting_table.h"

namespace palpate::inline v0 {

// What a path that nobody gave is to touch, and what was chosen.

/// What people say about a probing path. All may be empty: then it is chosen.
struct ProbeAim {
  std::optional<std::array<double, 2>> pixel = {};  ///< of the depth image; this or `point_W`
  std::optional<Vec3d> point_W = {};                ///< m, on a surface that the camera sees
  std::optional<Vec3d> tip_T = {};                  ///< m, on the tool: the end that leads
};

/// For people; decides nothing any more.
struct ProbeChoice {
  double u = 0, v = 0;    ///< pixel at which the tool goes in
  Vec3d p_W;              ///< the surface there when it arrives
  double time = 0;        ///< s, when that is
  Vec3d tip_T;            ///< the point of the tool that leads
  std::string why_place;  ///< "the nearest ..."
  std::string why_tip;
  std::string note;  ///< what people should know about the path, and what helps; else empty
};

/// How to choose otherwise, by the options of `palpate touch`.
inline constexpr const char* kHowToAim =
    "aim with --probe u,v (a pixel of the depth image) or --probe x,y,z (a point, m, in camera "
    "axes); choose the end that leads with --tip x,y,z (a point of the tool, m, in the frame of "
    "its mesh)";

/// Largest values of a run, of all ticks.
struct RunPeaks {
  double force = 0, torque = 0;                  ///< N and N m, on the hand
  double wanted_force = 0;                       ///< N, before the safety filter
  double contact_force = 0, contact_torque = 0;  ///< N and N m, on the tool
  double contact_force_time = 0;                 ///< s
  double stretch = 0;                            ///< m
  double volume = 0, volume_time = 0;            ///< m3, s
  double objects_volume = 0, objects_volume_time = 0;
  double unseen_volume = 0, unseen_volume_time = 0;  ///< Penetration::unseen_volume
  double energy = 0;                                 ///< J, given to the hand
  double spring_energy = 0;                          ///< J
  std::uint64_t num_engaged = 0, num_limited = 0, num_in_contact = 0,
                num_in_objects = 0;  ///< ticks

  void add(const TickRecord& tick);
};

/// What people have to say about a run while it goes on. Any thread adds, one takes.
class RunMarks {
 public:
  struct Mark {
    double time = 0;  ///< s, monotonic
    std::string text;
  };

  /// A note in the recording, at this moment.
  void add(std::string text);
  /// All that were added since the last call.
  std::vector<Mark> take();

 private:
  std::mutex mutex_;
  std::vector<Mark> marks_;
};

/// Who looks on while a run is recorded.
struct RunMonitor {
  RunObserver observer;  ///< hears what the recorder hears, after it
  /// The loop once it has started, and null before it is stopped: then it must not be used any
  /// more. From the thread of record_run.
  std::function<void(RunLoop*)> on_loop;
  RunMarks marks;
};

/// How a recording is kept that would become too large: in parts that can each be repeated and
/// shown by themselves, and all together.
struct RecordingOptions {
  /// s of the run; what is older is removed, and wrench.csv has the rest.
  double keep_seconds = std::numeric_limits<double>::infinity();
  double split_bytes = std::numeric_limits<double>::infinity();  ///< a part is about so large
  /// Nothing is recorded while less is free on the disk; none: 1 GiB, or 2 % of a smaller disk.
  std::optional<double> reserve_bytes = {};

  bool is_bounded() const { return keep_seconds < std::numeric_limits<double>::infinity(); }
};

struct RunOptions {
  double duration = std::numeric_limits<double>::infinity();  ///< s, of the computer's clock
  /// Asked ten times a second; false ends the run, which is kept.
  std::function<bool()> keep_going = {};
  /// Hears at once what people should know: faults, the force's return, the end of the recording.
  /// From the thread that records.
  std::function<void(double time, std::string_view text)> say = {};
  RunMonitor* monitor = nullptr;
  RecordingOptions recording = {};
  std::optional<ProbeChoice> probe = {};  ///< told in the report; decides nothing
  // For a SteppedDevice:
  SimulatedClock clock = {};
  double time_origin = 0;  ///< s, on the clock of path and frames: when the run's clock is 0
};

/// What a finished run tells.
struct RunOutcome {
  LoopReport loop;
  RunPeaks peaks;
  RunSettings settings;  ///< as used
  std::string summary_json;
  std::vector<std::string> warnings;  ///< for humans
  std::string why_not_cuda;           ///< if the fastest backend was asked for and it is another
  std::string failure;                ///< why it ended early; else empty
  std::string not_kept;               ///< what could not be written, and why; else empty
  bool was_interrupted = false;       ///< keep_going() was false
};

/// Runs live, or on the clock of a SteppedDevice, until the device or a source ends, a fault, or
/// as the options say. What was recorded is kept in any case; a disk that is full or slow
/// interrupts or thins the recording, says so, and never disturbs the loop. Errors: settings,
/// source, device, folder: nothing has run then.
Result<RunOutcome> record_run(const Tool& tool, const DepthSources& sources, HapticDevice& device,
                              const RunSettings& settings, const std::filesystem::path& folder,
                              const RunOptions& options = {});

/// Is this the folder of a run, be it one of another version?
bool is_run(const std::filesystem::path& folder);

/// How a repetition compares with the run.
struct ReplayOutcome {
  std::size_t num_ticks = 0, num_contacts = 0;
  /// The first number that differs, as "tick N, PLACE: recorded ..., repeated ..."; empty if all
  /// are the same bit for bit.
  std::string difference;
  std::string note;  ///< what could not be repeated, and why; else empty
};
struct ReplayOptions {
  std::optional<int> num_threads = {};  ///< nullopt: as recorded
  std::function<bool()> keep_going = {};
};

/// Repeats every contact and every tick from recording.mcap alone, as fast as it can, and compares
/// them bit by bit with what was recorded. A recording that was cut off is repeated as far as it
/// goes. Errors: no recording; stopped by keep_going.
Result<ReplayOutcome> replay_run(const std::filesystem::path& folder,
                                 const ReplayOptions& options = {});

/// How the forces of two runs of the same hand differ, tick by tick.
struct ForceComparison {
  std::size_t num_ticks = 0;               ///< that both have
  double rms = 0, max = 0;                 ///< N, of the difference of the forces on the tool
  double max_time = 0;                     ///< s
  double peak_before = 0, peak_after = 0;  ///< N, largest force on the tool
};
struct RetryOutcome {
  RunOutcome run;
  ForceComparison forces;
};
/// What the same hand and the same frames would have given with other settings, on a simulated
/// clock: writes a run of its own. `change` gets the recorded settings; a monitor hears the ticks.
Result<RetryOutcome> retry_run(const std::filesystem::path& folder,
                               const std::filesystem::path& output,
                               const std::function<Status(RunSettings&)>& change,
                               const RunOptions& options = {});

// Settings as people write them: TOML files.

/// Sets what the file names, [coupling] stiffness = 800, and returns the keys. Errors: file and
/// line of what cannot be read, a key that is not in the table (with the nearest one), a value out
/// of range. Then the settings are partly those of the file.
Result<std::vector<std::string>> read_settings_file(const std::filesystem::path& path,
                                                    SettingTable table);

/// What the file does not name is as in `defaults`.
template <class Options>
Result<Options> load_settings(const std::filesystem::path& path, Options defaults = {}) {
  const auto read = read_settings_file(path, settings_of(defaults));
  if (!read) return read.error();
  return defaults;
}

/// How runs average depth unless somebody says otherwise: estimated, where every camera stands
/// still.
DepthAverage usual_average(std::span<const DepthStreamInfo> streams) noexcept;

/// Such a file with the values as they are, and a comment on every key: what it means, its range
/// and its unit.
std::string settings_toml(const SettingTable& table);

}  // namespace palpate::inline v0
