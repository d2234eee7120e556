#include <chrono>
#include <optional>
#include <thread>
#include <utility>

#include "palpate/session/run.h"
#include "src/run/internal/pipeline.h"
#include "src/session/internal/run_folder.h"
#include "src/session/recording/nearest_watch.h"
#include "src/session/recording/run_recorder.h"
#include "src/session/recording/unit_watch.h"
#include "src/session/report/run_results.h"

namespace palpate { inline namespace v0 {
namespace fs = std::filesystem;
namespace {

/// Warns when most of the tool is in unseen space, and when it no longer is.
class UnseenWatch {
 public:
  explicit UnseenWatch(double full_volume) : full_volume_(full_volume) {}

  /// Returns the warning at this tick; mostly empty.
  std::string_view look(const TickRecord& tick) {
    const double share = tick.penetration.unseen_volume / full_volume_;
    // Between the two limits the state stays as it was.
    const bool is_unseen = is_reported_ ? share > kSeen : share > kUnseen;
    if (is_unseen == is_reported_) {
      since_ = tick.time;
      return {};
    }
    if (tick.time - since_ < kPatience) return {};
    is_reported_ = is_unseen;
    if (is_unseen && !(tick.penetration.volume > 0)) {
      return "most of the tool is out of the cameras' view: nothing is felt there";
    }
    return is_unseen ? "most of the tool is in unobserved space: the contact there is an assumption"
                     : "the cameras see the tool's surroundings again";
  }

 private:
  static constexpr double kUnseen = 0.5, kSeen = 0.25;  // shares that are warned of, taken back
  static constexpr double kPatience = 0.25;             // s until a change is reported

  double full_volume_, since_ = 0;
  bool is_reported_ = false;
};

/// Records a run: the observer that the publishing thread calls.
class RecordingObserver {
 public:
  RecordingObserver(const Tool& tool, double full_volume, const DepthSources& sources,
                    const RunOptions& options)
      : sources_(sources),
        unseen_(full_volume),
        newest_(sources.infos()),
        unit_(tool, sources.size()),
        nearest_(tool),
        monitor_(options.monitor),
        say_(options.say) {}
  /// Sets recorder and results, before the run begins.
  void begin(RunRecorder recorder, RunResults results) {
    recorder_.emplace(std::move(recorder));
    results_.emplace(std::move(results));
  }

  RunObserver observer() {
    RunObserver observer;
    observer.on_settings = [this](std::uint32_t revision, const RunSettings& settings) {
      recorder_->add_settings(revision, settings);
      results_->add_settings(settings);
      tell(&RunObserver::on_settings, revision, settings);
    };
    observer.on_frame = [this](const FrameRecord& record, const DepthFrame& frame) {
      recorder_->add_frame(record, frame);
      results_->add_frame(record, frame);
      newest_.take(record, frame);
      tell(&RunObserver::on_frame, record, frame);
    };
    observer.on_contact = [this](const ContactRecord& contact) {
      recorder_->add_contact(contact);
      results_->add_contact(contact);
      nearest_.take(contact);
      if (newest_.is_due(contact.time)) {
        unit_.look(newest_.all(), contact.X_WT);
        nearest_.look(newest_.all(), contact);
      }
      if (unit_.has_waited(contact.time)) add_unit_doubts(contact.time);
      tell(&RunObserver::on_contact, contact);
    };
    observer.on_ticks = [this](std::span<const TickRecord> ticks) {
      for (const TickRecord& tick : ticks) add(tick);
      add_marks();
      add_source_notes(ticks.back().time);
      tell(&RunObserver::on_ticks, ticks);
    };
    observer.on_note = [this](std::string_view text) {
      recorder_->add_note(text);
      say(time_, text);
      tell(&RunObserver::on_note, text);
    };
    return observer;
  }
  /// Adds notes of the depth streams: printed at once, recorded, and kept for the summary.
  void add_source_notes(double time) {
    for (DepthSource* source : sources_) {
      for (std::string& text : source->take_notes()) {
        const std::string& name = source->info().name;
        if (sources_.size() > 1 && !text.starts_with(name)) text = name + ": " + text;
        add_source_note(time, std::move(text));
      }
    }
  }
  void add_unit_doubts(double time) {
    for (std::string& text : unit_.doubts()) add_source_note(time, std::move(text));
  }
  const std::vector<std::string>& source_notes() const { return source_notes_; }
  /// Adds the marks of users.
  void add_marks() {
    if (monitor_ == nullptr) return;
    for (const auto& [time, text] : monitor_->marks.take()) recorder_->add_note(text, time);
  }

  RunRecorder& recorder() { return *recorder_; }
  RunResults& results() { return *results_; }
  std::optional<NearestApproach> nearest() const { return nearest_.nearest(); }

 private:
  /// Calls a callback of the monitor, if it has that one.
  template <class Callback, class... What>
  void tell(Callback RunObserver::*callback, const What&... what) {
    if (monitor_ != nullptr && monitor_->observer.*callback) {
      (monitor_->observer.*callback)(what...);
    }
  }
  void add_source_note(double time, std::string text) {
    say(time, text);
    recorder_->add_note(text);
    if (source_notes_.size() < kMaxSourceNotes) source_notes_.push_back(std::move(text));
  }
  void add(const TickRecord& tick) {
    recorder_->add_tick(tick);
    results_->add_tick(tick);
    time_ = tick.time;
    // The force's rise at the beginning and its fade at the end need no note.
    const std::string_view change =
        describe_change(std::exchange(safety_, tick.safety), tick.safety);
    if (!change.empty() && safety_.num_faults > 0 && safety_.fault != Fault::stopped) {
      recorder_->add_note(change);
      say(tick.time, change);
    }
    if (const std::string_view text = unseen_.look(tick); !text.empty()) {
      recorder_->add_note(text);
      say(tick.time, text);
    }
    for (const std::string& text : recorder_->take_notes()) say(tick.time, text);
  }
  void say(double time, std::string_view text) const {
    if (say_) say_(time, text);
  }

  static constexpr std::size_t kMaxSourceNotes = 100;

  const DepthSources& sources_;
  UnseenWatch unseen_;
  NewestFrames newest_;
  UnitWatch unit_;
  NearestWatch nearest_;
  std::vector<std::string> source_notes_;
  std::optional<RunRecorder> recorder_;
  std::optional<RunResults> results_;
  RunMonitor* monitor_;
  std::function<void(double, std::string_view)> say_;
  SafetyStatus safety_;  // of the last tick
  double time_ = 0;      // likewise, s
};

/// Waits for the end of the run; false: the user has ended it.
bool wait_for_end(RunLoop& loop, const RunOptions& options) {
  using Clock = std::chrono::steady_clock;
  const auto start = Clock::now();
  for (int round = 0; loop.is_running(); ++round) {
    const std::chrono::duration<double> elapsed = Clock::now() - start;
    if (elapsed.count() >= options.duration) return true;
    if (round % 20 == 0 && options.keep_going && !options.keep_going()) return false;
    const auto rest = std::chrono::duration<double>(options.duration) - elapsed;
    std::this_thread::sleep_for(
        std::min<std::chrono::duration<double>>(std::chrono::milliseconds(5), rest));
  }
  return true;
}

/// Waits for the recorder; calls `is_long` once if the disk takes seconds.
void finish(RunRecorder& recorder, const std::function<void()>& is_long) {
  constexpr auto kRound = std::chrono::milliseconds(5);
  constexpr int kLongRounds = 400;
  recorder.end();
  for (int round = 0; recorder.waits_for_disk(); ++round) {
    if (round == kLongRounds) is_long();
    std::this_thread::sleep_for(kRound);
  }
  recorder.finish();
}

struct ChosenLoop {
  std::unique_ptr<RunLoop> loop;
  std::string why_not_cuda;
};

/// Makes a loop on the backend of the settings, which is chosen if they leave it open.
Result<ChosenLoop> choose_loop(const Tool& tool, const DepthSources& sources, HapticDevice& device,
                               RunSettings& settings, const RunOptions& options,
                               const RunObserver& observer) {
  auto* const stepped = dynamic_cast<SteppedDevice*>(&device);
  const auto make = [&](Backend backend) {
    settings.backend = backend;
    return stepped != nullptr
               ? RunLoop::simulate(tool, sources, *stepped, settings, options.clock, observer)
               : RunLoop::create(tool, sources, device, settings, observer);
  };
  std::string why_not_cuda;
  const bool is_open = !settings.backend && !settings.wants_std;
  auto loop = make(settings.backend.value_or(settings.wants_std ? Backend::cpu : Backend::cuda));
  if (!loop && is_open) {
    why_not_cuda = loop.error().message;
    loop = make(Backend::cpu);
  }
  if (!loop) return loop.error();
  return ChosenLoop{*std::move(loop), why_not_cuda};
}

/// Takes the report of a loop that has stopped.
void take_report(const RunLoop& loop, const Status& status, RunLog& log) {
  log.loop = loop.report();
  // A path that was played to its end is no failure.
  if (!status && status.error().code == Errc::cancelled) {
    log.loop.ending = status.error().message;
  } else if (!status) {
    log.failure = status.error().message;
  }
  log.warnings = log.loop.notes;
  if (log.loop.num_lost_records > 0) {
    log.warnings.push_back(std::to_string(log.loop.num_lost_records) +
                           " records were lost because the disk or the processor was too slow; a "
                           "faster disk or a smaller image helps");
  }
}

}  // namespace

Result<RunOutcome> record_run(const Tool& tool, const DepthSources& sources, HapticDevice& device,
                              const RunSettings& settings, const fs::path& name,
                              const RunOptions& options) {
  if (!(options.duration > 0)) {
    return Error{Errc::invalid_argument, "the duration must be above 0 seconds"};
  }
  auto folder = RunFolder::create(name);
  if (!folder) return folder.error();
  RunLog log;
  log.setup = {settings, sources.infos(), device.info(), 0, options.time_origin, options.probe};
  RunSettings& used = log.setup.settings;
  RecordingObserver recording(tool, full_volume(tool, used.contact), sources, options);
  auto chosen = choose_loop(tool, sources, device, used, options, recording.observer());
  if (!chosen) return chosen.error();
  RunLoop& loop = *chosen->loop;
  log.why_not_cuda = chosen->why_not_cuda;
  const auto coupling = check_coupling(used.coupling, device.info().limits, 1 / device.info().rate,
                                       tool.sphere_mass());
  if (!coupling) return coupling.error();
  log.coupling = coupling->options;
  log.newtons_per_cubic_meter =
      thesis_volume_stiffness(log.coupling.force_at_eighth, full_volume(tool, used.contact))
          .newtons_per_cubic_meter;
  const bool is_simulated = dynamic_cast<SteppedDevice*>(&device) != nullptr;
  if (!is_simulated) {
    const std::chrono::duration<double> since_1970 =
        std::chrono::system_clock::now().time_since_epoch();
    log.setup.time_origin = since_1970.count();
  }
  auto recorder = RunRecorder::create(folder->partial() / kRecordingFile, tool, log.setup,
                                      is_simulated, options.recording);
  if (!recorder) return recorder.error();
  recording.begin(*std::move(recorder),
                  RunResults(folder->partial(), tool, log.setup, !options.recording.is_bounded()));
  if (const Status status = loop.start(); !status) return status.error();
  // From here on the folder is kept under its name, whatever happens to the program.
  if (const Status status = folder->commit(); !status) {
    loop.stop();
    return status.error();
  }
  recording.recorder().has_moved_to(folder->target());

  const auto notify_loop = [&](RunLoop* running) {
    if (options.monitor != nullptr && options.monitor->on_loop) {
      options.monitor->on_loop(running);
    }
  };
  notify_loop(&loop);
  log.was_interrupted = !wait_for_end(loop, options);
  notify_loop(nullptr);
  Status status = loop.status();
  loop.stop();
  // The loop may have failed to switch off the motors, or to record the rest.
  if (status && !is_simulated) status = loop.status();
  take_report(loop, status, log);
  recording.add_marks();
  recording.add_source_notes(log.loop.seconds);
  recording.add_unit_doubts(log.loop.seconds);
  for (const std::string& text : log.warnings) recording.recorder().add_note(text);
  if (!log.loop.ending.empty()) recording.recorder().add_note(log.loop.ending);
  log.warnings.insert(log.warnings.end(), recording.source_notes().begin(),
                      recording.source_notes().end());
  if (options.probe && !options.probe->note.empty()) log.warnings.push_back(options.probe->note);
  finish(recording.recorder(), [&] {
    if (options.say) options.say(log.loop.seconds, "waits until the disk has the recording");
  });
  if (const std::string& trouble = recording.recorder().trouble(); !trouble.empty()) {
    log.add_not_kept(trouble);
  }
  log.nearest = recording.nearest();
  std::string summary = recording.results().write(folder->target(), tool, loop.times(), log);
  return RunOutcome{log.loop,         log.peaks,   used,         std::move(summary),  log.warnings,
                    log.why_not_cuda, log.failure, log.not_kept, log.was_interrupted, log.nearest};
}

void RunMarks::add(std::string text) {
  const std::chrono::duration<double> now = std::chrono::steady_clock::now().time_since_epoch();
  const std::lock_guard lock(mutex_);
  marks_.push_back({now.count(), std::move(text)});
}

std::vector<RunMarks::Mark> RunMarks::take() {
  const std::lock_guard lock(mutex_);
  return std::exchange(marks_, {});
}

}}  // namespace palpate::v0
