// palpate touch, once everything is open: on a simulated clock along a path, or live in a hand.
#include <algorithm>
#include <atomic>
#include <cmath>
#include <cstdio>
#include <iostream>
#include <limits>
#include <span>
#include <utility>
#include <vector>

#include "apps/page.h"
#include "apps/terminal/terminal.h"
#include "apps/touch/held_frames.h"
#include "apps/touch/touch.h"
#include "palpate/devices/devices.h"
#include "palpate/session/run.h"
#include "palpate/viewer/viewer.h"
#include "src/haptics/internal/hand.h"
#include "src/run/internal/run_inputs.h"

namespace palpate::apps {
namespace {

/// Places a hand at the beginning of the path unless the settings place it. Replays are not moved.
void place(const TouchOptions& options, const TouchInput& input, CouplingOptions& coupling) {
  const bool has_hand = !options.device.empty() && !options.is_replay();
  const bool is_placed =
      options.is_given("coupling.base_in_scene") || options.is_given("coupling.tool_in_hand");
  if (!has_hand || input.path.empty() || is_placed) return;
  const auto stands = standing_pose(options.cameras.front());
  const Pose X_WC = input.X_WC ? *input.X_WC : stands && *stands ? **stands * input.X_FC : Pose{};
  place_hand(X_WC, input.path.front().X_WT, coupling);
}

/// Returns the pose of the handle along the path, by time since the start of the run.
HandTarget follow(const TouchOptions& options, const TouchInput& input,
                  const CouplingOptions& coupling) {
  const bool is_handle = options.is_path_of_handle();
  return [&path = input.path, start = input.path_start, coupling, is_handle](double time) {
    const Pose pose = pose_at(path, start + time);
    return is_handle ? pose : handle_at(coupling, pose);
  };
}

Result<std::unique_ptr<HapticDevice>> make_simulated_hand(const TouchOptions& options,
                                                          HandTarget target) {
  const std::string model_name = options.device.size() > 4 ? options.device.substr(4) : "";
  const auto model = model_name.empty() ? device_models().front() : find_device_model(model_name);
  if (!model) return open_device(options.device);  // for its error message
  SimulatedDeviceOptions simulated;
  simulated.model = *model;
  simulated.target = std::move(target);
  auto device = SimulatedDevice::create(simulated);
  if (!device) return device.error();
  return std::unique_ptr<HapticDevice>(*std::move(device));
}

/// Returns the duration of the run from --duration or the path, s; infinite: until the frames end.
Result<double> path_duration(const TouchOptions& options, const TouchInput& input) {
  if (input.path.empty()) {
    return Error{Errc::bad_input, input.stream().name + " has no path of its own: give --path"};
  }
  if (options.duration) return *options.duration;
  const double length = input.path.back().time - input.path_start;
  if (length > 0) return length;
  if (input.stream().num_frames) return std::numeric_limits<double>::infinity();
  return Error{Errc::bad_input, "neither the path nor the frames end: pass --duration"};
}

Result<std::unique_ptr<HapticDevice>> make_path(const TouchOptions& options,
                                                const TouchInput& input,
                                                const RunSettings& settings, double duration) {
  PathDeviceOptions path;
  path.X_BH = follow(options, input, settings.coupling);
  path.duration = duration;
  path.rate = settings.contact_rate;
  path.limits = find_device_model("sigma.7")->limits;  // as of replay: and other silent devices
  path.name = !options.path.empty() ? "path " + options.path
              : input.probe         ? "a path that probes one place"
                                    : "the path of the scene";
  auto device = make_path_device(std::move(path));
  if (!device) return device.error();
  return std::unique_ptr<HapticDevice>(*std::move(device));
}

Result<std::unique_ptr<HapticDevice>> make_device(const TouchOptions& options,
                                                  const TouchInput& input,
                                                  const RunSettings& settings) {
  if (options.is_replay()) {
    const HandTarget target = follow(options, input, settings.coupling);
    std::vector<TimedPose> X_BH{{input.path_start, target(0)}};
    for (const TimedPose& pose : input.path) {
      if (pose.time > input.path_start) {
        X_BH.push_back({pose.time, target(pose.time - input.path_start)});
      }
    }
    return make_replay_device(options.device.substr(7), std::move(X_BH));
  }
  if (options.is_simulated_hand() && !input.path.empty()) {
    return make_simulated_hand(options, follow(options, input, settings.coupling));
  }
  if (!options.is_robot()) return open_device(options.device);
  // Frame and maximum age of the robot's poses default to those of the camera and of the output.
  const std::size_t parameters = std::min(options.device.find('?'), options.device.size());
  std::string address = options.device.substr(0, parameters);
  std::string more = options.device.substr(parameters);
  const std::string& frame = input.stream().frame;
  if (address.find('@') == std::string::npos && !frame.empty()) address += "@" + frame;
  if (options.ros.is_requested && more.find("max_age=") == std::string::npos) {
    more += (more.empty() ? "?" : "&") + ("max_age=" + shortest_decimal(options.ros.max_age));
  }
  return open_device(address + more);
}

/// Short text about the newest tick: written by one thread, read by another.
class TickWatch {
 public:
  void take(const TickRecord& tick) {
    time_ = tick.time;
    force_ = norm(tick.step.contact_W.force);
    number_ = tick.number;
  }

  double time() const { return time_; }
  /// Returns time since the start, force on the tool and, for a live run, its tick rate, as text.
  std::string words(bool is_live) {
    const double elapsed = time_ - counted_time_;
    if (elapsed >= 1) {
      rate_ = static_cast<double>(number_ - counted_number_) / elapsed;
      counted_time_ = time_;
      counted_number_ = number_;
    }
    char text[48], rate[24] = "";
    std::snprintf(text, sizeof text, "%.1f s, %.2f N", time(), force_.load());
    if (is_live && rate_ > 0) std::snprintf(rate, sizeof rate, ", %.0f Hz", rate_);
    return std::string(text) + rate + "; Ctrl-C ends the run";
  }

 private:
  std::atomic<double> time_ = 0, force_ = 0;  // s, N
  std::atomic<std::uint64_t> number_ = 0;
  double rate_ = 0, counted_time_ = 0;  // Hz, s
  std::uint64_t counted_number_ = 0;
};

std::string counted(std::uint64_t number, const char* name) {
  return std::to_string(number) + " " + name + (number == 1 ? "" : "s");
}

/// Prints what the tool felt, and what was computed for it.
void print_result(const Tool& tool, const RunOutcome& outcome) {
  const LoopReport& loop = outcome.loop;
  const RunPeaks& peaks = outcome.peaks;
  char text[200], on_hand[40] = "";
  if (outcome.settings.coupling.kind != CouplingKind::none) {
    std::snprintf(on_hand, sizeof on_hand, ", on the hand %.3g N", peaks.force);
  }
  if (outcome.nearest) {
    std::snprintf(text, sizeof text, "the tool never touched; nearest %.2g m at %.1f s\n",
                  outcome.nearest->distance, outcome.nearest->time);
  } else {
    std::snprintf(text, sizeof text,
                  "largest force on the tool %.3g N%s; deepest %.4g cm³ (%.2f %% of the tool) at "
                  "%.3f s\n",
                  peaks.contact_force, on_hand, peaks.volume * 1e6,
                  100 * peaks.volume / full_volume(tool, outcome.settings.contact),
                  peaks.volume_time);
  }
  results() << text;
  if (!outcome.settings.objects.empty()) {
    std::snprintf(text, sizeof text, "deepest in objects %.4g cm³\n", peaks.objects_volume * 1e6);
    results() << text;
  }
  std::snprintf(text, sizeof text, " in %.2f s\n", loop.seconds);
  results() << counted(loop.num_ticks, "tick") << ", " << loop.num_contacts
            << (loop.num_contacts == 1 ? " query, " : " queries, ")
            << counted(loop.num_frames, "depth frame") << text;
  if (!loop.ending.empty()) results() << "end: " << loop.ending << "\n";
}

void print_probe(const ProbeChoice& probe) {
  char text[160];
  std::snprintf(text, sizeof text, "probed the pixel %.0f,%.0f at %.3f, %.3f, %.3f m; ", probe.u,
                probe.v, probe.p_W.x, probe.p_W.y, probe.p_W.z);
  results() << text << kHowToAim << "\n";
}

/// Prints the results and warnings, except those already `said`; error if the run ended
/// prematurely.
Status tell(const TouchOptions& options, const Tool& tool, const RunOutcome& outcome,
            const std::optional<ProbeChoice>& probe, std::span<const std::string> said,
            bool is_cut_short) {
  note_backend(outcome.why_not_cuda);
  for (const std::string& text : outcome.warnings) {
    if (std::ranges::find(said, text) != said.end()) continue;
    print_note(text);
  }
  const bool is_complete = outcome.failure.empty() && outcome.not_kept.empty() && !is_cut_short;
  if (options.json && is_complete) {
    std::cout << outcome.summary_json;
  } else if (!options.json) {
    print_result(tool, outcome);
    if (probe) print_probe(*probe);
    print_report(options.output);
  }
  if (!outcome.not_kept.empty()) {
    return Error{Errc::io_failure, "not all of the run could be kept: " + outcome.not_kept +
                                       "; the files that were written are in " + options.output};
  }
  if (is_cut_short) {
    return Error{Errc::cancelled, "interrupted; the run so far is complete in " + options.output};
  }
  if (!outcome.failure.empty()) {
    return Error{Errc::unavailable, outcome.failure + "; the run so far is in " + options.output};
  }
  return Done{};
}

}  // namespace

Status touch(const TouchOptions& options, const Tool& tool, TouchInput input) {
  const bool is_live = !options.device.empty();
  const auto handle = options.is_page() ? std::make_shared<PageHandle>() : nullptr;
  RunSettings settings = options.settings;
  // Without a page that holds the tool there is no force.
  if (handle && !options.is_given("safety.dead_man")) settings.safety.dead_man = true;
  if (!options.is_given("coupling.kind")) {
    const bool has_hand = is_live && !options.is_robot();
    settings.coupling.kind = has_hand ? CouplingKind::virtual_coupling : CouplingKind::none;
  }
  use_sensor(input.stream().sensor, options.given, settings.surface);
  use_method(settings.contact.method, options.given, settings.surface);
  std::vector<DepthStreamInfo> streams;
  for (const auto& source : input.sources) streams.push_back(source->info());
  if (!options.is_given("time.average")) settings.time.average.kind = usual_average(streams);
  use_sensor(input.stream().sensor, options.given, settings.time);
  for (const DepthStreamInfo& s : streams) {
    const Status mode = check_mode(options.sensor, s.name, s.width, s.height, s.unit);
    if (!mode) return mode;
  }
  if (options.sensor.noise) use_noise(*options.sensor.noise, options.given, settings.time);
  // Estimates must not fill the gaps that removing the robot leaves.
  if (options.self_filter && !options.is_given("time.average_keep_frames")) {
    settings.time.average.keep_frames = 0;
  }
  place(options, input, settings.coupling);

  RunOptions run;
  run.probe = input.probe;
  run.recording = options.recording;
  run.time_origin = input.time_origin;
  double expected = std::numeric_limits<double>::infinity();
  Result<std::unique_ptr<HapticDevice>> device = Error{};
  if (is_live) {
    device = handle ? make_page_device(handle) : make_device(options, input, settings);
    if (options.duration) {
      expected = *options.duration;
    } else if (options.is_simulated_hand() && input.path.size() > 1) {
      expected = input.path.back().time - input.path_start;
    }
    run.duration = expected;
  } else {
    const auto duration = path_duration(options, input);
    if (!duration) return duration.error();
    expected = *duration;
    device = make_path(options, input, settings, *duration);
    // A probe of a few frames continues with the last one.
    run.clock = {input.frame_zero, !options.duration && !input.probe, options.has_page};
  }
  if (!device) return device.error();
  const bool outlasts_frames =
      is_live ? input.probe.has_value()
              : !run.clock.ends_with_frames && settings.coupling.kind != CouplingKind::none;
  const double length = is_live && !input.path.empty() ? input.path.back().time : expected;
  for (auto& source : input.sources) {
    if (outlasts_frames && source->info().num_frames) {
      source = std::make_unique<HeldFrames>(std::move(source), length);
    }
  }
  if (is_live && !(*device)->info().senses_orientation) {
    print_note((*device)->info().name + " senses no orientation: the tool does not turn");
  }

  std::vector<DepthSource*> sources;
  for (auto& source : input.sources) {
    if (is_live && !source->info().is_live) {
      auto ahead = read_ahead(std::move(source));
      if (!ahead) return ahead.error();
      source = *std::move(ahead);
    }
    sources.push_back(source.get());
  }

  const DepthStreamInfo& info = input.stream();
  const auto view = LiveView::create(tool, DepthSources(sources).infos(), info.name,
                                     {handle, options.settings.objects});
  std::optional<OpenPage> page;
  catch_interrupts();  // before the address of the page is printed
  if (options.has_page) {
    auto served = OpenPage::serve(*view, options.page, std::cerr);
    if (!served) return served.error();
    page = *std::move(served);
    run.monitor = &view->monitor();
  }
  RunMonitor listener;
  if (run.monitor == nullptr) run.monitor = &listener;
  std::unique_ptr<RosOutput> output;
  if (options.ros.is_requested) {
    RosOutputOptions ros = options.ros;
    ros.frame = settings.output.wrench_frame.value_or(WrenchFrame::tool);
    auto made = RosOutput::create(tool, settings.objects, DepthSources(sources).infos(), ros);
    if (!made) return made.error();
    output = *std::move(made);
    output->join(*run.monitor);
  }
  RunLoop* loop = nullptr;
  run.monitor->on_loop = [&loop, others = std::move(run.monitor->on_loop)](RunLoop* running) {
    loop = running;
    if (others) others(running);
  };
  std::optional<Suspension> suspension;
  if (is_live) suspension.emplace();
  TickWatch watch;
  run.monitor->observer.on_ticks = [&watch, others = std::move(run.monitor->observer.on_ticks)](
                                       std::span<const TickRecord> ticks) {
    watch.take(ticks.back());
    if (others) others(ticks);
  };
  std::optional<Progress> bar("touching");
  std::vector<std::string> said;
  if (input.probe) said.push_back(input.probe->note);
  run.say = [&said](double time, std::string_view text) {
    char seconds[32];
    std::snprintf(seconds, sizeof seconds, "%.2f s: ", time);
    print_beside_progress(seconds + said.emplace_back(text));
  };
  bool has_told_refusals = !is_live;
  run.keep_going = [&] {
    if (!has_told_refusals && loop != nullptr && watch.time() > 0.2) {
      has_told_refusals = true;
      // Real time and locked memory that this user may not have: a matter for the start.
      for (const std::string& note : loop->report().notes) {
        if (note.find("limits.conf") != note.npos) run.say(watch.time(), note);
      }
    }
    if (bar->due()) {
      bar->update(std::isfinite(expected) ? std::optional(watch.time() / expected) : std::nullopt,
                  watch.words(is_live));
    }
    if (loop != nullptr && suspension && suspension->is_requested()) {
      loop->suspend_force();
      suspension->stop();
      loop->resume_force();
    }
    return !interrupted() && !view->wants_end();
  };
  const auto outcome =
      record_run(tool, DepthSources(std::move(sources)), **device, settings, options.output, run);
  suspension.reset();
  bar.reset();
  if (page) page->print_closing();
  print_kept();
  if (!outcome) return outcome.error();
  return tell(options, tool, *outcome, input.probe, said, !is_live && interrupted());
}

}  // namespace palpate::apps
