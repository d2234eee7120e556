#include "src/session/haptic_results.h"

#include <utility>

#include "palpate/io/atomic_file.h"
#include "src/session/text.h"

namespace palpate {
namespace fs = std::filesystem;
namespace {

constexpr const char* kCsv = "wrench.csv";
constexpr const char* kUnfinishedCsv = "wrench.csv.part";

}  // namespace

HapticResults::HapticResults(const fs::path& folder)
    : csv_(folder / kUnfinishedCsv, std::ios::binary) {
  csv_ << "time_s,force_x_N,force_y_N,force_z_N,torque_x_Nm,torque_y_Nm,torque_z_Nm,volume_m3,"
          "tool_x_m,tool_y_m,tool_z_m,tool_qx,tool_qy,tool_qz,tool_qw,stretch_m,contact_age_s,"
          "sensor_age_s,gain,fault\n";
}

void HapticResults::add_tick(const HapticRecord& tick) {
  const auto& [force, torque] = tick.F_H_B;
  const auto& [p, q] = tick.step.X_WT;
  line_.clear();
  append_row(line_, ',', tick.time, force.x, force.y, force.z, torque.x, torque.y, torque.z,
             tick.penetration.volume, p.x, p.y, p.z, q.x, q.y, q.z, q.w, tick.step.stretch,
             tick.contact_age, tick.sensor_age, tick.safety.gain,
             static_cast<int>(tick.safety.fault));
  csv_ << line_;
  series_.add(tick);
  peaks_.add(tick);
  start_ = tick.device.time - tick.time;
}

void HapticResults::move_to(HapticLog& log) {
  log.series = std::move(series_);
  log.peaks = peaks_;
  log.changes = std::move(changes_);
  for (const double time : captures_) {
    if (time >= start_) log.frame_times.push_back(time - start_);
  }
}

void HapticResults::finish_csv(const fs::path& folder, HapticLog& log) {
  csv_.close();
  const fs::path unfinished = folder / kUnfinishedCsv;
  if (!csv_) {
    log.warnings.push_back(unfinished.string() + " is cut off: check the free space");
    return;
  }
  std::error_code error;
  fs::rename(unfinished, folder / kCsv, error);
  if (error) {
    log.warnings.push_back("cannot rename " + unfinished.string() + ": " + error.message());
  }
}

void HapticResults::write(const fs::path& folder, const Tool& tool, const LoopTimes& times,
                          HapticLog& log) {
  move_to(log);
  finish_csv(folder, log);
  const std::pair<const char*, std::string> files[] = {
      {"summary.json", haptic_summary_json(tool, log, times)},
      {"report.html", haptic_page(tool, log, times)}};
  for (const auto& [file, text] : files) {
    const Status status = write_file_atomically(folder / file, text);
    if (!status) log.warnings.push_back(status.error().message);
  }
}

}  // namespace palpate
