// palpate replay: the same run again, bit for bit.

#include <iostream>
#include <memory>
#include <nlohmann/json.hpp>

#include "apps/options.h"
#include "apps/terminal.h"
#include "apps/tool_info.h"
#include "apps/verbs.h"
#include "palpate/session/haptic_run.h"
#include "palpate/session/record_run.h"
#include "palpate/session/run_folder.h"

namespace palpate::apps {
namespace {

struct Options {
  std::string run, output;
  std::optional<int> num_threads;
  bool json = false;
};

Status run(const Options& options) {
  ReplayOptions replay;
  if (!options.output.empty()) {
    if (lies_inside(options.run, options.output)) {
      return Error{Errc::io_failure,
                   "the replay would replace the run it repeats: give another folder"};
    }
    replay.output = options.output;
  }
  replay.num_threads = options.num_threads;
  catch_interrupts();
  replay.keep_going = [](const TickRecord&) { return !interrupted(); };
  const bool is_haptic = is_haptic_run(options.run);
  const auto outcome =
      is_haptic ? replay_haptic_run(options.run, replay) : replay_run(options.run, replay);
  if (!outcome) return outcome.error();
  if (!outcome->difference.empty()) {
    return Error{Errc::bad_input, "the replay differs from " + options.run +
                                      (is_haptic ? "/session.mcap in " : "/wrench.csv in ") +
                                      outcome->difference};
  }
  if (!outcome->note.empty()) std::cerr << "palpate: note: " << outcome->note << '\n';
  if (options.json && is_haptic) {
    print_json({{"identical", true},
                {"ticks", outcome->num_ticks},
                {"contacts", outcome->num_contacts},
                {"note", outcome->note}});
  } else if (options.json) {
    print_json({{"identical", true}, {"ticks", outcome->num_ticks}});
  } else if (is_haptic) {
    std::cout << "identical: " << outcome->num_ticks << " ticks, " << outcome->num_contacts
              << " contact queries\n";
  } else {
    std::cout << "identical: " << outcome->num_ticks << " ticks\n";
  }
  return Done{};
}

}  // namespace

void add_replay(CLI::App& program, Action& action) {
  const auto options = std::make_shared<Options>();
  CLI::App& app = *program.add_subcommand(
      "replay", "Repeat a run from its recording and compare every number.");
  app.add_option("run", options->run, "folder that palpate touch wrote")
      ->required()
      ->type_name("RUN");
  app.add_option("-o,--output", options->output, "keep the repetition as a run of its own")
      ->type_name("RUN2");
  app.add_option("--threads", options->num_threads, "threads; default: as recorded")
      ->check(CLI::Range(0, 256));
  app.add_flag("--json", options->json, "print the verdict as JSON");
  app.footer("Example: palpate replay run1");
  app.callback([options, &action] { action = [options] { return run(*options); }; });
}

}  // namespace palpate::apps
