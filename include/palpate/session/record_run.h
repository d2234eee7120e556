// A run with everything that is kept of it, and its repetition.
//
//   wrench.csv      one line per tick; no compute times, so that two runs give the same bytes
//   timing.csv      compute times
//   summary.json    settings, counts, peaks, percentiles
//   report.html     the same for people, with plots and pictures
//   recording/      see recording.h
#pragma once

#include <filesystem>
#include <optional>
#include <string>

#include "palpate/core/result.h"
#include "palpate/session/session.h"

namespace palpate {

/// What a finished run tells.
struct RunOutcome {
  RunLog log;
  std::string summary_json;  ///< as in summary.json
  std::string warning;       ///< about frames that show hardly any surface; else empty
};

/// Runs and writes `folder`, whole or not at all. `keep_going` as RunCallbacks::on_tick: a run that
/// it stops is kept, marked as interrupted. `onlooker` hears all that the recorder hears, after it.
Result<RunOutcome> record_run(const Tool& tool, DepthSource& source, const PoseFunction& X_WT,
                              const RunSettings& settings, const std::filesystem::path& folder,
                              const std::function<bool(const TickRecord&)>& keep_going = {},
                              const RunCallbacks& onlooker = {});

/// How a repetition compares with the run.
struct ReplayOutcome {
  std::size_t num_ticks = 0;
  /// First line of wrench.csv that differs, as "line N: recorded '...', repeated '...'"; empty if
  /// the files are the same byte for byte.
  std::string difference;
  std::size_t num_contacts = 0;  ///< haptic runs: queries that were repeated
  std::string note = {};         ///< haptic runs: what could not be repeated, and why; else empty
};

struct ReplayOptions {
  std::optional<std::filesystem::path> output;  ///< where the repetition is kept as a run
  std::optional<int> num_threads;               ///< nullopt: as recorded
  std::function<bool(const TickRecord&)> keep_going;
};

/// Repeats the run in `folder` from its recording alone and compares wrench.csv. Errors: as
/// load_recording; no wrench.csv; stopped by keep_going.
Result<ReplayOutcome> replay_run(const std::filesystem::path& folder, const ReplayOptions& options);

}  // namespace palpate
