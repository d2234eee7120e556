// Report of a run: as JSON, and as a page for humans.
#pragma once

#include <nlohmann/json_fwd.hpp>
#include <optional>
#include <string>
#include <vector>

#include "palpate/session/run.h"
#include "palpate/tool/tool.h"
#include "src/session/internal/run_messages.h"
#include "src/session/recording/change_list.h"
#include "src/session/report/run_series.h"

namespace palpate { inline namespace v0 {

/// A time without force.
struct FaultPeriod {
  double time = 0;  ///< s since the run began
  Fault fault = Fault::none;
  std::optional<double> seconds = {};  ///< until the force came back; none: it did not
};

/// All data of a run that has ended.
struct RunLog {
  RunSetup setup;
  CouplingOptions coupling;                        ///< checked
  double newtons_per_cubic_meter = 0;              ///< volume stiffness of contact
  ChangeList changes = ChangeList(RunSettings{});  ///< of the settings, while it ran
  LoopReport loop;
  RunSeries series;
  RunPeaks peaks;
  std::vector<FaultPeriod> faults;  ///< the first kMaxFaultPeriods, without the end of the run
  TickRecord deepest;               ///< the tick with the largest volume, or the first one
  RunSettings deepest_settings;     ///< of that tick
  BodyPoses deepest_bodies;         ///< at its contact
  /// The frame in use then, of each camera; no pixels where it is not known.
  std::vector<DepthFrame> deepest_frames;
  std::vector<double> frame_times;    ///< s since the run began
  std::vector<std::string> warnings;  ///< for humans
  std::string why_not_cuda;           ///< as RunOutcome
  std::string failure;                ///< why it ended early; else empty
  std::string not_kept;               ///< as RunOutcome
  bool was_interrupted = false;
  std::optional<NearestApproach> nearest;  ///< as RunOutcome

  void add_not_kept(const std::string& what) { not_kept += (not_kept.empty() ? "" : "; ") + what; }
  bool has_hand() const { return coupling.kind != CouplingKind::none; }
};

/// Returns the content of summary.json.
nlohmann::ordered_json run_summary(const Tool& tool, const RunLog& log, const LoopTimes& times);
/// JSON as a file.
std::string file_text(const nlohmann::ordered_json& json);

/// One self-contained HTML page with the summary, the course of the run and its deepest moment.
/// Error: this build has no pages.
Result<std::string> run_page(const nlohmann::ordered_json& summary, const Tool& tool,
                             const RunLog& log, const LoopTimes& times);

}}  // namespace palpate::v0
