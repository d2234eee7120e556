// A recorded run: its files, and its replay.
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

namespace palpate { inline namespace v0 {

// The target of an automatic probing path, and the choice that was made.

/// Optional target of a probing path. Empty members are chosen automatically.
struct ProbeAim {
  std::optional<std::array<double, 2>> pixel = {};  ///< of the depth image; or use `point_W`
  std::optional<Vec3d> point_W = {};                ///< m, on a visible surface
  std::optional<Vec3d> tip_T = {};                  ///< m, on the tool: the leading end
};

/// The automatic choice, for display only.
struct ProbeChoice {
  double u = 0, v = 0;    ///< target pixel
  Vec3d p_W;              ///< the surface point at contact
  double time = 0;        ///< s, time of contact
  Vec3d tip_T;            ///< the leading point of the tool
  std::string why_place;  ///< "the nearest ..."
  std::string why_tip;
  std::string note;  ///< problems of the path and how to avoid them; else empty
};

/// Maxima of a run over all ticks.
struct RunPeaks {
  double force = 0, torque = 0;                  ///< N and N m, on the hand
  double desired_force = 0;                      ///< N, before the safety filter
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

  /// Counts one more tick.
  void add(const TickRecord& tick);
};

/// Marks that users add during a run. Any thread adds, one takes.
class RunMarks {
 public:
  /// A note of a user at a time.
  struct Mark {
    double time = 0;  ///< s, monotonic
    std::string text;
  };

  /// Adds a note to the recording, at this moment.
  void add(std::string text);
  /// Returns all marks since the last call.
  std::vector<Mark> take();

 private:
  std::mutex mutex_;
  std::vector<Mark> marks_;
};

/// Observer of a run that is being recorded.
struct RunMonitor {
  RunObserver observer;  ///< called after the recorder, with the same data
  /// Called with the loop once it has started, and with null before it is stopped: then it must not
  /// be used anymore. From the thread of record_run.
  std::function<void(RunLoop*)> on_loop;
  RunMarks marks;
};

/// Limits for long recordings: they are split into parts that can be viewed alone or together. A
/// run can be repeated if its first part is there.
struct RecordingOptions {
  /// s of the run; older data is removed, and wrench.csv has the rest.
  double keep_seconds = std::numeric_limits<double>::infinity();
  double split_bytes = std::numeric_limits<double>::infinity();  ///< approximate size of a part
  /// Recording pauses below this free disk space; none: 1 GiB, or 2 % of a smaller disk.
  std::optional<double> reserve_bytes = {};

  bool is_bounded() const { return keep_seconds < std::numeric_limits<double>::infinity(); }
};

/// Options of record_run that are not settings of the run.
struct RunOptions {
  double duration = std::numeric_limits<double>::infinity();  ///< s, on the computer's clock
  /// Called ten times per second; false ends the run, which is kept.
  std::function<bool()> keep_going = {};
  /// Called with messages for the user: faults, recoveries, the end of the recording. From the
  /// recording thread.
  std::function<void(double time, std::string_view text)> say = {};
  RunMonitor* monitor = nullptr;
  RecordingOptions recording = {};
  std::optional<ProbeChoice> probe = {};  ///< for the report only
  // For a SteppedDevice:
  SimulatedClock clock = {};
  double time_origin = 0;  ///< s, on the clock of path and frames: zero of the run's clock
};

/// The nearest approach of a tool that never touched: from the depth measurements, without objects.
struct NearestApproach {
  double distance = 0, time = 0;  ///< m, s
};

/// Result of a finished run.
struct RunOutcome {
  LoopReport loop;
  RunPeaks peaks;
  RunSettings settings;  ///< as used
  std::string summary_json;
  std::vector<std::string> warnings;  ///< for display
  std::string why_not_cuda;           ///< if auto was requested and the backend is not CUDA
  std::string failure;                ///< reason for an early end; else empty
  std::string not_kept;               ///< files that could not be written, and why; else empty
  bool was_interrupted = false;       ///< keep_going() was false
  std::optional<NearestApproach> nearest = {};  ///< none: it touched, or nothing was measured
};

/// Runs live, or on the clock of a SteppedDevice, until the device or a source ends, a fault, or
/// the limits in the options. Everything recorded so far is always kept; a full or slow disk pauses
/// or thins the recording, with a message, and never disturbs the loop. Errors: settings, source,
/// device, folder: then nothing has run.
Result<RunOutcome> record_run(const Tool& tool, const DepthSources& sources, HapticDevice& device,
                              const RunSettings& settings, const std::filesystem::path& folder,
                              const RunOptions& options = {});

/// True if this is the folder of a run, also of another version.
bool is_run(const std::filesystem::path& folder);

/// Comparison of a replay with the run.
struct ReplayOutcome {
  std::size_t num_ticks = 0, num_contacts = 0;
  /// The first difference, as "tick N, PLACE: recorded ..., repeated ..."; empty if everything is
  /// the same bit for bit.
  std::string difference;
  std::string note;  ///< part that could not be replayed, and why; else empty
};
/// Options of replay_run.
struct ReplayOptions {
  std::optional<int> num_threads = {};  ///< nullopt: as recorded
  std::function<bool()> keep_going = {};
  std::function<void(double share)> progress = {};  ///< called with the replayed share, 0 to 1
};

/// Repeats every contact and every tick from recording.mcap alone, as fast as possible, and
/// compares them bit by bit with the recording. A truncated recording is repeated as far as it
/// goes. Errors: no recording, or one that begins later than its run; stopped by keep_going.
Result<ReplayOutcome> replay_run(const std::filesystem::path& folder,
                                 const ReplayOptions& options = {});

/// Force difference of two runs with the same hand motion, tick by tick.
struct ForceComparison {
  std::size_t num_ticks = 0;               ///< in both runs
  double rms = 0, max = 0;                 ///< N, of the difference of the forces on the tool
  double max_time = 0;                     ///< s
  double peak_before = 0, peak_after = 0;  ///< N, maximum force on the tool
};
/// Result of retry_run.
struct RetryOutcome {
  RunOutcome run;
  ForceComparison forces;
};
/// Computes the same hand motion and frames with other settings, on a simulated clock, and writes a
/// new run. `change` gets the recorded settings; a monitor gets the ticks; `progress` as in
/// ReplayOptions, from another thread.
Result<RetryOutcome> retry_run(const std::filesystem::path& folder,
                               const std::filesystem::path& output,
                               const std::function<Status(RunSettings&)>& change,
                               const RunOptions& options = {},
                               const std::function<void(double share)>& progress = {});

// Settings files (TOML).

/// Applies a file, e.g. [coupling] stiffness = 800, and returns the keys. Errors: file and line of
/// a syntax error, an unknown key (with the nearest one), a value out of range. Then the settings
/// may be partly changed.
Result<std::vector<std::string>> read_settings_file(const std::filesystem::path& path,
                                                    SettingTable table);

/// Settings that the file does not contain are as in `defaults`.
template <class Options>
Result<Options> load_settings(const std::filesystem::path& path, Options defaults = {}) {
  const auto read = read_settings_file(path, settings_of(defaults));
  if (!read) return read.error();
  return defaults;
}

/// The default average of runs: kalman if no camera
/// moves.
DepthAverage usual_average(std::span<const DepthStreamInfo> streams) noexcept;

/// The text of a settings file with the current values, and a comment per key: its meaning, range
/// and unit.
std::string settings_toml(const SettingTable& table);

}}  // namespace palpate::v0
