// What a haptic run tells: as JSON, and as a page for people.
#pragma once

#include <string>
#include <vector>

#include "palpate/tool/tool.h"
#include "src/session/haptic_messages.h"
#include "src/session/haptic_series.h"

namespace palpate {

/// All that is known once a haptic run has ended.
struct HapticLog {
  HapticSetup setup;
  CouplingOptions coupling;             ///< checked
  std::vector<HapticSettings> changes;  ///< while it ran, in order
  LoopReport loop;
  HapticSeries series;
  HapticPeaks peaks;
  std::vector<double> frame_times;    ///< s since the loop began
  std::vector<std::string> warnings;  ///< for people
  std::string failure;                ///< why it ended early; else empty
};

std::string haptic_summary_json(const Tool& tool, const HapticLog& log, const LoopTimes& times);
/// One self-contained HTML page.
std::string haptic_page(const Tool& tool, const HapticLog& log, const LoopTimes& times);

}  // namespace palpate
