// A hand on a device, live: the loop, all that it did in one MCAP file, and its repetition.
//
//   session.mcap   settings, tool, depth frames, contact queries, ticks and notes: whole up to the
//                  last second even if the program is killed
//   summary.json   settings, counts, percentiles of every stage, faults
//   wrench.csv     one line per tick
//   report.html    the same for people
#pragma once

#include <filesystem>
#include <functional>
#include <mutex>
#include <string>
#include <vector>

#include "palpate/run/haptic_loop.h"
#include "palpate/session/probe_choice.h"
#include "palpate/session/record_run.h"

namespace palpate {

struct HapticOutcome {
  LoopReport loop;
  std::string summary_json;
  std::vector<std::string> warnings;  ///< of the coupling and the loop, for people
  std::string failure;                ///< why it ended early; else empty
};

/// What people have to say about a run while it goes on. Any thread adds, one takes.
class HapticMarks {
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
struct HapticOnlooker {
  HapticObserver observer;  ///< hears what the recorder hears, after it
  /// The loop once it has started, and null before it is stopped: then it must not be used any
  /// more. From the thread of record_haptic_run.
  std::function<void(HapticLoop*)> on_loop;
  HapticMarks marks;
};

/// Runs until `duration` (s), the end of the source, a fault, or keep_going() is false (asked ten
/// times a second). What was recorded is kept in any case; a disk that is full or slow ends or
/// thins the recording, says so, and never disturbs the loop. `probe` is told in the report.
/// Errors: settings, source, device, folder: nothing has run then.
Result<HapticOutcome> record_haptic_run(const Tool& tool, DepthSource& source, HapticDevice& device,
                                        const HapticSettings& settings, double duration,
                                        const std::filesystem::path& folder,
                                        const std::function<bool()>& keep_going = {},
                                        HapticOnlooker* onlooker = nullptr,
                                        const std::optional<ProbeChoice>& probe = {});

/// Is this the folder of a haptic run?
bool is_haptic_run(const std::filesystem::path& folder);

/// Repeats every contact query and every tick from session.mcap alone, as fast as it can, and
/// compares them bit by bit with what was recorded. A recording that was cut off is repeated as far
/// as it goes.
Result<ReplayOutcome> replay_haptic_run(const std::filesystem::path& folder,
                                        const ReplayOptions& options = {});

}  // namespace palpate
