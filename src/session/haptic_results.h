// What a haptic run leaves behind beside its recording: wrench.csv, summary.json, report.html.
#pragma once

#include <filesystem>
#include <fstream>
#include <string>
#include <vector>

#include "src/session/haptic_report.h"

namespace palpate {

class HapticResults {
 public:
  /// Begins wrench.csv, under another name until it is finished.
  explicit HapticResults(const std::filesystem::path& folder);

  void add_settings(const HapticSettings& settings) { changes_.push_back(settings); }
  /// s, monotonic.
  void add_frame(double capture_time) { captures_.push_back(capture_time); }
  void add_tick(const HapticRecord& tick);

  /// After the last tick: what was added goes into `log`, and all into files. The folder may have
  /// another name by now. A disk that is full takes nothing from what there is: what is missing is
  /// told in `log.warnings`.
  void write(const std::filesystem::path& folder, const Tool& tool, const LoopTimes& times,
             HapticLog& log);

 private:
  void move_to(HapticLog& log);
  void finish_csv(const std::filesystem::path& folder, HapticLog& log);

  std::ofstream csv_;
  std::string line_;
  std::vector<HapticSettings> changes_;
  HapticSeries series_;
  HapticPeaks peaks_;
  std::vector<double> captures_;  // s, monotonic
  double start_ = 0;              // s, monotonic: of the loop
};

}  // namespace palpate
