#include "palpate/session/haptic_run.h"

#include <chrono>
#include <fstream>
#include <optional>
#include <thread>
#include <utility>

#include "palpate/io/atomic_file.h"
#include "palpate/io/tool_file.h"
#include "palpate/session/checksum.h"
#include "palpate/session/run_folder.h"
#include "src/session/haptic_recording.h"
#include "src/session/haptic_report.h"
#include "src/session/text.h"

namespace palpate {
namespace fs = std::filesystem;
namespace {

constexpr const char* kCsv = "wrench.csv";
constexpr const char* kUnfinishedCsv = "wrench.csv.part";

/// wrench.csv, line by line while the run goes on.
class CsvWriter {
 public:
  explicit CsvWriter(const fs::path& path) : file_(path, std::ios::binary) {
    file_ << "time_s,force_x_N,force_y_N,force_z_N,torque_x_Nm,torque_y_Nm,torque_z_Nm,volume_m3,"
             "tool_x_m,tool_y_m,tool_z_m,tool_qx,tool_qy,tool_qz,tool_qw,stretch_m,contact_age_s,"
             "sensor_age_s,gain,fault\n";
  }
  void add(const HapticRecord& tick) {
    const auto& [force, torque] = tick.F_H_B;
    const auto& [p, q] = tick.step.X_WT;
    line_.clear();
    append_row(line_, ',', tick.time, force.x, force.y, force.z, torque.x, torque.y, torque.z,
               tick.volume, p.x, p.y, p.z, q.x, q.y, q.z, q.w, tick.step.stretch, tick.contact_age,
               tick.sensor_age, tick.safety.gain, static_cast<int>(tick.safety.fault));
    file_ << line_;
  }
  bool finish() {
    file_.close();
    return static_cast<bool>(file_);
  }

 private:
  std::ofstream file_;
  std::string line_;
};

/// All that is kept of a run while it goes on; what the publishing thread calls.
class Keeper {
 public:
  Keeper(HapticRecorder recorder, const fs::path& csv)
      : recorder_(std::move(recorder)), csv_(csv) {}

  HapticObserver observer() {
    HapticObserver observer;
    observer.on_frame = [this](std::uint64_t number, double capture_time, const DepthFrame& frame) {
      recorder_.add_frame(number, capture_time, frame);
      captures_.push_back(capture_time);
    };
    observer.on_contact = [this](const ContactRecord& contact) { recorder_.add_contact(contact); };
    observer.on_ticks = [this](std::span<const HapticRecord> ticks) {
      for (const HapticRecord& tick : ticks) add(tick);
    };
    return observer;
  }

  HapticRecorder& recorder() { return recorder_; }
  CsvWriter& csv() { return csv_; }
  /// Once the loop has stopped.
  void move_to(HapticLog& log) {
    log.series = std::move(series_);
    log.peaks = peaks_;
    for (const double time : captures_) {
      if (time >= start_) log.frame_times.push_back(time - start_);
    }
  }

 private:
  void add(const HapticRecord& tick) {
    recorder_.add_tick(tick);
    csv_.add(tick);
    series_.add(tick);
    peaks_.add(tick);
    start_ = tick.device.time - tick.time;
    if (tick.safety.fault != fault_) {
      fault_ = tick.safety.fault;
      recorder_.add_note(describe(fault_));
    }
  }

  HapticRecorder recorder_;
  CsvWriter csv_;
  HapticSeries series_;
  HapticPeaks peaks_;
  std::vector<double> captures_;  // s, monotonic
  double start_ = 0;              // s, monotonic: of the loop
  Fault fault_ = Fault::none;
};

void wait_for_end(HapticLoop& loop, double duration, const std::function<bool()>& keep_going) {
  using Clock = std::chrono::steady_clock;
  const auto start = Clock::now();
  for (int round = 0; loop.is_running(); ++round) {
    const std::chrono::duration<double> elapsed = Clock::now() - start;
    if (elapsed.count() >= duration) return;
    if (round % 5 == 0 && keep_going && !keep_going()) return;
    const auto rest = std::chrono::duration<double>(duration) - elapsed;
    std::this_thread::sleep_for(
        std::min<std::chrono::duration<double>>(std::chrono::milliseconds(20), rest));
  }
}

/// Saves the tool beside the recording; its checksum.
Result<std::string> keep_tool(const Tool& tool, const fs::path& path) {
  if (const Status status = save_tool(tool, path); !status) return status.error();
  const auto bytes = read_file(path);
  if (!bytes) return bytes.error();
  return checksum(*bytes);
}

/// What comes after the run. A disk that is full takes nothing from what there is.
void write_results(const Tool& tool, const HapticLoop& loop, const fs::path& folder, Keeper& keeper,
                   HapticLog& log) {
  keeper.move_to(log);
  for (const std::string& text : log.warnings) keeper.recorder().add_note(text);
  keeper.recorder().finish();
  const auto warn = [&](std::string text) { log.warnings.push_back(std::move(text)); };
  if (const std::string& trouble = keeper.recorder().trouble(); !trouble.empty()) warn(trouble);
  std::error_code error;
  if (keeper.csv().finish())
    fs::rename(folder / kUnfinishedCsv, folder / kCsv, error);
  else
    warn((folder / kUnfinishedCsv).string() + " is cut off: check the free space");
  if (error) warn("cannot rename " + (folder / kUnfinishedCsv).string() + ": " + error.message());
  const std::pair<const char*, std::string> files[] = {
      {"summary.json", haptic_summary_json(tool, log, loop.times())},
      {"report.html", haptic_page(tool, log, loop.times())}};
  for (const auto& [file, text] : files) {
    const Status status = write_file_atomically(folder / file, text);
    if (!status) warn(status.error().message);
  }
}

}  // namespace

Result<HapticOutcome> record_haptic_run(const Tool& tool, DepthSource& source, HapticDevice& device,
                                        const HapticSettings& settings, double duration,
                                        const fs::path& name,
                                        const std::function<bool()>& keep_going) {
  if (!(duration > 0)) {
    return Error{Errc::invalid_argument, "the duration must be above 0 seconds"};
  }
  auto folder = RunFolder::create(name);
  if (!folder) return folder.error();
  const auto tool_checksum = keep_tool(tool, folder->partial() / kHapticTool);
  if (!tool_checksum) return tool_checksum.error();

  HapticLog log;
  log.setup = {settings, source.info(), device.info(), *tool_checksum};
  const auto coupling =
      check_coupling(settings.coupling, device.info().limits, 1 / device.info().rate);
  if (!coupling) return coupling.error();
  log.coupling = coupling->options;
  auto recorder = HapticRecorder::create(folder->partial() / kHapticRecording, log.setup);
  if (!recorder) return recorder.error();
  Keeper keeper(*std::move(recorder), folder->partial() / kUnfinishedCsv);
  auto loop = HapticLoop::create(tool, source, device, settings, keeper.observer());
  if (!loop) return loop.error();
  if (const Status status = (*loop)->start(); !status) return status.error();
  // From here on a folder of this name is kept, whatever happens to the program.
  if (const Status status = folder->commit(); !status) return status.error();

  wait_for_end(**loop, duration, keep_going);
  // A path that was played to its end is no failure.
  const Status status = (*loop)->status();
  if (!status && status.error().code != Errc::cancelled) log.failure = status.error().message;
  (*loop)->stop();
  log.loop = (*loop)->report();
  log.warnings = log.loop.notes;
  if (log.loop.num_lost_records > 0) {
    log.warnings.push_back(std::to_string(log.loop.num_lost_records) +
                           " records were lost because the disk or the processor was too slow; a "
                           "faster disk or a smaller image helps");
  }
  write_results(tool, **loop, folder->target(), keeper, log);
  return HapticOutcome{log.loop, haptic_summary_json(tool, log, (*loop)->times()), log.warnings,
                       log.failure};
}

}  // namespace palpate
