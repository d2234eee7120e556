#include "palpate/session/record_run.h"

#include <algorithm>
#include <string_view>
#include <utility>

#include "palpate/io/atomic_file.h"
#include "palpate/session/recording.h"
#include "palpate/session/report.h"
#include "palpate/session/run_folder.h"
#include "src/session/run_files.h"

namespace palpate {
namespace fs = std::filesystem;
namespace {

std::string_view take_line(std::string_view& text) {
  const std::size_t end = std::min(text.find('\n'), text.size());
  const std::string_view line = text.substr(0, end);
  text.remove_prefix(std::min(end + 1, text.size()));
  return line;
}

std::string first_difference(std::string_view recorded, std::string_view repeated) {
  if (recorded == repeated) return {};
  for (int number = 1;; ++number) {
    const bool end = recorded.empty() && repeated.empty();
    const std::string_view a = take_line(recorded), b = take_line(repeated);
    if (a == b && !end) continue;
    return "line " + std::to_string(number) + ": recorded '" + std::string(a) + "', repeated '" +
           std::string(b) + "'";
  }
}

}  // namespace

Result<RunOutcome> record_run(const Tool& tool, DepthSource& source, const PoseFunction& X_WT,
                              const RunSettings& settings, const fs::path& name,
                              const std::function<bool(const TickRecord&)>& keep_going,
                              const RunCallbacks& onlooker) {
  auto folder = RunFolder::create(name);
  if (!folder) return folder.error();
  auto recorder = Recorder::create(folder->partial() / kRecordingFolder, tool, settings.objects);
  if (!recorder) return recorder.error();
  RunCallbacks callbacks;
  callbacks.on_session = onlooker.on_session;
  callbacks.on_tick = [&](const TickRecord& tick) {
    return (!keep_going || keep_going(tick)) && (!onlooker.on_tick || onlooker.on_tick(tick));
  };
  callbacks.on_frame = [&](std::size_t index, double time, const DepthFrame& frame) {
    const Status status = recorder->add_frame(index, time, frame);
    return status && onlooker.on_frame ? onlooker.on_frame(index, time, frame) : status;
  };
  auto log = run_session(tool, source, X_WT, settings, callbacks);
  if (!log) return log.error();
  if (const Status status = recorder->finish(*log); !status) return status.error();

  auto report = make_report(tool, *log);
  if (!report) return report.error();
  RunOutcome outcome{*std::move(log), {}, {}};
  outcome.summary_json = summary_json(tool, outcome.log);
  outcome.warning = scarce_surface_warning(outcome.log);
  const std::pair<const char*, std::string> files[] = {
      {"wrench.csv", wrench_csv(tool, outcome.log)},
      {"timing.csv", timing_csv(outcome.log)},
      {"summary.json", outcome.summary_json},
      {"report.html", *std::move(report)}};
  for (const auto& [file, text] : files) {
    const Status status = write_file_atomically(folder->partial() / file, text);
    if (!status) return status.error();
  }
  if (const Status status = folder->commit(); !status) return status.error();
  return outcome;
}

Result<ReplayOutcome> replay_run(const fs::path& folder, const ReplayOptions& options) {
  auto recording = load_recording(folder / kRecordingFolder);
  if (!recording) return recording.error();
  const auto recorded = read_file(folder / "wrench.csv");
  if (!recorded) return recorded.error();

  RunSettings settings = recording->settings;
  settings.duration = static_cast<double>(recording->poses.size()) / settings.rate;
  settings.end_with_source = false;
  if (options.num_threads) settings.num_threads = *options.num_threads;
  const PoseFunction X_WT = [&](std::size_t tick, double) { return recording->poses[tick]; };

  RunLog log;
  if (options.output) {
    auto outcome = record_run(recording->tool, *recording->frames, X_WT, settings, *options.output,
                              options.keep_going);
    if (!outcome) return outcome.error();
    log = std::move(outcome->log);
  } else {
    RunCallbacks callbacks;
    callbacks.on_tick = options.keep_going;
    auto result = run_session(recording->tool, *recording->frames, X_WT, settings, callbacks);
    if (!result) return result.error();
    log = *std::move(result);
  }
  if (log.interrupted) {
    return Error{Errc::cancelled, "the replay was interrupted before its end"};
  }
  return ReplayOutcome{log.ticks.size(),
                       first_difference(*recorded, wrench_csv(recording->tool, log))};
}

}  // namespace palpate
