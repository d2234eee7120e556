// palpate replay: repeats a run, bit for bit, or with other settings.

#include <cmath>
#include <iostream>
#include <memory>
#include <nlohmann/json.hpp>
#include <optional>

#include "apps/options.h"
#include "apps/terminal/terminal.h"
#include "apps/tool_info.h"
#include "apps/verbs.h"
#include "palpate/session/run.h"
#include "src/session/internal/run_folder.h"

namespace palpate::apps {
namespace {

constexpr const char* kHowToEnd = "Ctrl-C ends it";

struct Options {
  std::string run, output;
  RunSettings settings;              ///< only to check the given values
  std::vector<std::string> changes;  ///< words of the command line that change settings
  std::optional<int> num_threads;
  bool json = false;
};

/// Adds options for all settings; the defaults are those of the recorded run.
void add_all_settings(CLI::App& app, RunSettings& settings) {
  app.add_option_function<std::string>(
         "--settings",
         [&settings](const std::string& path) {
           const auto read = read_settings_file(path, settings_of(settings));
           if (!read) throw CLI::ValidationError(read.error().message);
         },
         "settings file as for palpate touch; other options override it")
      ->trigger_on_parse()
      ->type_name("FILE.toml");
  const SettingTable table = settings_of(settings);
  add_setting_options(app, "Contact", table, kContactOptions);
  add_setting_options(app, "From depth to surface", table, kSurfaceOptions);
  add_setting_options(app, "Between depth images", table, kTimeOptions);
  add_setting_options(app, "Hand", table, kHandOptions);
  add_setting_options(app, "Speed", table, kLoopOptions);
  add_threads_option(app, settings.num_threads, kThreadsHelp);
  add_set_option(app, table);
}

/// Returns the given ones of these options as words of a command line.
std::vector<std::string> given_words(const CLI::App& app, const CLI::App& known) {
  std::vector<std::string> words;
  for (const CLI::Option* option : app.get_options()) {
    const std::string name = option->get_name();
    if (option->count() == 0 || known.get_option_no_throw(name) == nullptr) continue;
    if (option->get_items_expected_max() == 0) {
      words.push_back(name);
    } else {
      for (const std::string& value : option->results()) words.push_back(name + "=" + value);
    }
  }
  return words;
}

Status parse(const std::vector<std::string>& words, RunSettings& settings) {
  CLI::App app;
  add_all_settings(app, settings);
  try {
    app.parse(std::vector<std::string>(words.rbegin(), words.rend()));
  } catch (const CLI::ParseError& error) {
    return Error{Errc::invalid_argument, error.what()};
  }
  return Done{};
}

/// Applies the words to the recorded settings; options that a new method does not have are dropped,
/// and surfaces that were smoothed as is usual become those of the new method: named in `note`.
Status change(const std::vector<std::string>& words, RunSettings& settings, std::string& note) {
  RunSettings desired = settings;
  if (const Status status = parse(words, desired); !status) return status;
  Smoothing& smoothing = settings.surface.filter.smoothing;
  const Smoothing before = smoothing;
  const bool was_usual = before == usual_smoothing(settings.contact.method);
  settings.contact.method = desired.contact.method;
  for (const std::string& name : drop_foreign_options(settings.contact)) {
    note += (note.empty() ? "dropped options of the run that the method " +
                                name_of(settings.contact.method) + " does not have: "
                          : ", ") +
            name;
  }
  const Smoothing usual = usual_smoothing(settings.contact.method);
  if (was_usual) smoothing = usual;
  const Status status = parse(words, settings);
  if (smoothing != before && smoothing == usual) {
    note += (note.empty() ? "" : "; ") + ("surface.smoothing is " + name_of(smoothing)) +
            ", as is usual with this method";
  }
  return status;
}

Status repeat(const Options& options) {
  ReplayOptions replay;
  replay.num_threads = options.num_threads;
  replay.keep_going = [] { return !interrupted(); };
  std::optional<Progress> bar("repeating");
  replay.progress = [&](double share) { bar->update(share, kHowToEnd); };
  const auto outcome = replay_run(options.run, replay);
  bar.reset();
  if (!outcome) return outcome.error();
  if (!outcome->difference.empty()) {
    return Error{Errc::bad_input, "the replay differs from " + options.run + "/" + kRecordingFile +
                                      " in " + outcome->difference};
  }
  if (!outcome->note.empty()) print_note(outcome->note);
  if (options.json) {
    print_json({{"identical", true},
                {"ticks", outcome->num_ticks},
                {"contacts", outcome->num_contacts},
                {"note", outcome->note}});
  } else {
    results() << "identical: " << outcome->num_ticks << " ticks, " << outcome->num_contacts
              << " contact queries\n";
  }
  return Done{};
}

Status retry(const Options& options) {
  if (lies_inside(options.run, options.output)) {
    return Error{Errc::io_failure,
                 "the replay would replace the run it repeats: give another folder"};
  }
  RunOptions run;
  run.keep_going = [] { return !interrupted(); };
  std::string note;
  std::optional<Progress> bar("repeating");
  const auto outcome = retry_run(
      options.run, options.output,
      [&](RunSettings& settings) { return change(options.changes, settings, note); }, run,
      [&](double share) { bar->update(share, kHowToEnd); });
  bar.reset();
  if (!outcome) return outcome.error();
  if (!note.empty()) print_note(note);
  note_backend(outcome->run.why_not_cuda);
  for (const std::string& text : outcome->run.warnings) {
    print_note(text);
  }
  const ForceComparison& forces = outcome->forces;
  if (options.json) {
    print_json({{"output", options.output},
                {"ticks", forces.num_ticks},
                {"force_difference_rms_N", forces.rms},
                {"force_difference_max_N", forces.max},
                {"force_difference_max_time_s", forces.max_time},
                {"peak_force_before_N", forces.peak_before},
                {"peak_force_after_N", forces.peak_after}});
  } else {
    char text[240];
    std::snprintf(text, sizeof text,
                  "%zu ticks; force on the tool differs by %.4g N rms, at most %.4g N at %.3f s; "
                  "largest force %.4g N before, %.4g N now\n",
                  forces.num_ticks, forces.rms, forces.max, forces.max_time, forces.peak_before,
                  forces.peak_after);
    results() << text;
    print_report(options.output);
  }
  if (!outcome->run.not_kept.empty()) {
    return Error{Errc::io_failure, "not all of the run could be kept: " + outcome->run.not_kept};
  }
  if (outcome->run.was_interrupted) {
    return Error{Errc::cancelled, "the replay was interrupted before its end"};
  }
  if (!outcome->run.failure.empty()) return Error{Errc::unavailable, outcome->run.failure};
  return Done{};
}

Status run(const Options& options) {
  catch_interrupts();
  return options.output.empty() ? repeat(options) : retry(options);
}

}  // namespace

void add_replay(CLI::App& program, Action& action) {
  const auto options = std::make_shared<Options>();
  CLI::App& app = *program.add_subcommand(
      "replay", "Repeat a run from its recording, or compute it with other settings.");
  app.add_option("run", options->run, "folder of a run")->required()->type_name("RUN");
  app.add_option("-o,--output", options->output,
                 "write a new run: the same motion and frames with these settings")
      ->type_name("RUN2");
  add_all_settings(app, options->settings);
  app.add_flag("--json", options->json, "print the verdict as JSON");
  app.footer(
      "Example: palpate replay run1\n"
      "Example: palpate replay run1 -o run2 --method graph --time latest");
  app.callback([options, &app, &action] {
    RunSettings unused;
    CLI::App known;
    add_all_settings(known, unused);
    options->changes = given_words(app, known);
    if (app.count("--threads") > 0) options->num_threads = options->settings.num_threads;
    const bool only_threads = options->changes.size() == app.count("--threads");
    if (options->output.empty() && !only_threads) {
      usage_error("replay: other settings make a new run: pass its folder with -o RUN2");
    }
    action = [options] { return run(*options); };
  });
}

}  // namespace palpate::apps
