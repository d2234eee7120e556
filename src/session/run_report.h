// What a run tells: as JSON, and as a page for people.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "palpate/session/run.h"
#include "palpate/tool/tool.h"
#include "src/session/run_messages.h"
#include "src/session/run_series.h"

namespace palpate {

/// A time without force.
struct FaultPeriod {
  double time = 0;  ///< s since the run began
  Fault fault = Fault::none;
  std::optional<double> seconds = {};  ///< until the force came back; none: it did not
};

/// All that is known once a run has ended.
struct RunLog {
  RunSetup setup;
  CouplingOptions coupling;            ///< checked
  double newtons_per_cubic_metre = 0;  ///< volume stiffness of contact
  std::vector<RunSettings> changes;    ///< while it ran, in order
  LoopReport loop;
  RunSeries series;
  RunPeaks peaks;
  std::vector<FaultPeriod> faults;    ///< the first kMostFaultPeriods, without the end of the run
  TickRecord deepest;                 ///< the tick with the largest volume, or the first one
  DepthFrame deepest_frame;           ///< that was felt then; no pixels if it is not known
  std::vector<double> frame_times;    ///< s since the run began
  std::vector<std::string> warnings;  ///< for people
  std::string why_not_cuda;           ///< as RunOutcome
  std::string failure;                ///< why it ended early; else empty
  std::string not_kept;               ///< as RunOutcome
  bool was_interrupted = false;

  void add_not_kept(const std::string& what) { not_kept += (not_kept.empty() ? "" : "; ") + what; }
  bool has_hand() const { return coupling.kind != CouplingKind::none; }
};

std::string summary_json(const Tool& tool, const RunLog& log, const LoopTimes& times);
/// One self-contained HTML page.
std::string run_page(const Tool& tool, const RunLog& log, const LoopTimes& times);

}  // namespace palpate
