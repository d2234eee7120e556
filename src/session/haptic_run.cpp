#include "palpate/session/haptic_run.h"

#include <chrono>
#include <optional>
#include <thread>
#include <utility>

#include "palpate/io/atomic_file.h"
#include "palpate/io/tool_file.h"
#include "palpate/session/checksum.h"
#include "palpate/session/run_folder.h"
#include "src/session/haptic_recording.h"
#include "src/session/haptic_results.h"

namespace palpate {
namespace fs = std::filesystem;
namespace {

/// All that is kept of a run while it goes on; what the publishing thread calls.
class Keeper {
 public:
  /// `onlooker` may be null.
  Keeper(HapticRecorder recorder, const fs::path& folder, HapticOnlooker* onlooker)
      : recorder_(std::move(recorder)), results_(folder), onlooker_(onlooker) {}

  HapticObserver observer() {
    HapticObserver observer;
    observer.on_settings = [this](std::uint32_t revision, const HapticSettings& settings) {
      recorder_.add_settings(revision, settings);
      results_.add_settings(settings);
      tell(&HapticObserver::on_settings, revision, settings);
    };
    observer.on_frame = [this](std::uint64_t number, double capture_time, const DepthFrame& frame,
                               std::uint32_t revision) {
      recorder_.add_frame(number, capture_time, frame, revision);
      results_.add_frame(capture_time);
      tell(&HapticObserver::on_frame, number, capture_time, frame, revision);
    };
    observer.on_contact = [this](const ContactRecord& contact) {
      recorder_.add_contact(contact);
      tell(&HapticObserver::on_contact, contact);
    };
    observer.on_ticks = [this](std::span<const HapticRecord> ticks) {
      for (const HapticRecord& tick : ticks) add(tick);
      add_marks();
      tell(&HapticObserver::on_ticks, ticks);
    };
    return observer;
  }
  /// Of people.
  void add_marks() {
    if (onlooker_ == nullptr) return;
    for (const auto& [time, text] : onlooker_->marks.take()) recorder_.add_note(text, time);
  }

  HapticRecorder& recorder() { return recorder_; }
  HapticResults& results() { return results_; }

 private:
  /// What the onlooker wants to hear.
  template <class Callback, class... What>
  void tell(Callback HapticObserver::*callback, const What&... what) {
    if (onlooker_ != nullptr && onlooker_->observer.*callback) {
      (onlooker_->observer.*callback)(what...);
    }
  }
  void add(const HapticRecord& tick) {
    recorder_.add_tick(tick);
    results_.add_tick(tick);
    if (tick.safety.fault != fault_) {
      fault_ = tick.safety.fault;
      recorder_.add_note(describe(fault_));
    }
  }

  HapticRecorder recorder_;
  HapticResults results_;
  HapticOnlooker* onlooker_;
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

/// What comes after the run.
void write_results(const Tool& tool, const HapticLoop& loop, const fs::path& folder, Keeper& keeper,
                   HapticLog& log) {
  keeper.add_marks();
  HapticRecorder& recorder = keeper.recorder();
  for (const std::string& text : log.warnings) recorder.add_note(text);
  recorder.finish();
  if (!recorder.trouble().empty()) log.warnings.push_back(recorder.trouble());
  keeper.results().write(folder, tool, loop.times(), log);
}

}  // namespace

Result<HapticOutcome> record_haptic_run(const Tool& tool, DepthSource& source, HapticDevice& device,
                                        const HapticSettings& settings, double duration,
                                        const fs::path& name,
                                        const std::function<bool()>& keep_going,
                                        HapticOnlooker* onlooker,
                                        const std::optional<ProbeChoice>& probe) {
  if (!(duration > 0)) {
    return Error{Errc::invalid_argument, "the duration must be above 0 seconds"};
  }
  auto folder = RunFolder::create(name);
  if (!folder) return folder.error();
  const auto tool_checksum = keep_tool(tool, folder->partial() / kHapticTool);
  if (!tool_checksum) return tool_checksum.error();

  HapticLog log;
  log.setup = {settings, source.info(), device.info(), *tool_checksum, 0, probe};
  const auto coupling = check_coupling(settings.coupling, device.info().limits,
                                       1 / device.info().rate, tool.sphere_mass());
  if (!coupling) return coupling.error();
  log.coupling = coupling->options;
  auto recorder = HapticRecorder::create(folder->partial() / kHapticRecording, log.setup);
  if (!recorder) return recorder.error();
  Keeper keeper(*std::move(recorder), folder->partial(), onlooker);
  auto loop = HapticLoop::create(tool, source, device, settings, keeper.observer());
  if (!loop) return loop.error();
  if (const Status status = (*loop)->start(); !status) return status.error();
  // From here on a folder of this name is kept, whatever happens to the program.
  if (const Status status = folder->commit(); !status) return status.error();

  const auto tell_of = [onlooker](HapticLoop* running) {
    if (onlooker != nullptr && onlooker->on_loop) onlooker->on_loop(running);
  };
  tell_of(loop->get());
  wait_for_end(**loop, duration, keep_going);
  tell_of(nullptr);
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
