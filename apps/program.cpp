#include "apps/program.h"

#include <unistd.h>

#include <algorithm>
#include <cstdlib>
#include <exception>
#include <iostream>
#include <new>
#include <vector>

#include "apps/terminal/help.h"
#include "apps/terminal/terminal.h"
#include "palpate/version.h"
#include "src/core/internal/guarded.h"
#include "src/settings/internal/did_you_mean.h"

namespace palpate::apps {

int fail(const std::string& program, const std::string& message, int status) {
  print_kept();
  std::cerr << red(program + ":") << " " << printable(message) << std::endl;
  return status;
}

namespace {

/// Returns an error about the first unknown option or superfluous word of a verb; else nothing. The
/// parser itself first asks for what is missing.
std::string unknown_words(const CLI::App& verb) {
  const std::vector<std::string> words = verb.remaining();
  if (words.empty() || verb.get_prefix_command()) return {};
  const auto option =
      std::ranges::find_if(words, [](const std::string& word) { return word.starts_with('-'); });
  if (option == words.end()) return "'" + words.front() + "' is one word too many";
  const std::string flag = option->substr(0, option->find('='));
  std::vector<std::string> known;
  for (const CLI::Option* other : verb.get_options()) {
    for (const std::string& word : other->get_lnames()) known.push_back("--" + word);
  }
  const std::string unknown = "there is no option '" + flag + "'";
  if (flag == "--stiffness" && std::ranges::count(known, "--set") > 0) {
    return unknown +
           "; newtons of a run are set by --set coupling.force_at_eighth=N, those at an "
           "eighth of the tool's volume";
  }
  return unknown + did_you_mean(flag, known);
}

/// Prints one line about an invalid command line.
int fail_usage(const CLI::App& program, const CLI::ParseError& error) {
  std::string what = error.what(), verb;
  const std::string& name = program.get_name();
  const auto end = [&] {
    const std::string hint = "see " + name + " " + verb + "--help";
    return fail(name, what + (what.ends_with('?') ? " (" + hint + ")" : "; " + hint), kWrongUsage);
  };
  // The parser's message about lists, also about one that is too short and ends in the next option.
  if (const std::string start = "Could not convert: "; what.starts_with(start)) {
    const auto chosen = program.get_subcommands();
    const CLI::App& app = chosen.empty() ? program : *chosen.front();
    const std::size_t equals = what.find(" = ");
    const std::string flag = what.substr(start.size(), equals - start.size());
    const CLI::Option* const option = app.get_option_no_throw(flag);
    if (option != nullptr && equals != std::string::npos) {
      what = flag + ": give " + option->get_type_name() + ", not '" + what.substr(equals + 3) + "'";
    }
  }
  if (program.get_subcommands({}).empty()) {
    if (const std::string unknown = unknown_words(program); !unknown.empty()) what = unknown;
    return end();
  }
  if (const auto chosen = program.get_subcommands(); !chosen.empty()) {
    verb = chosen.front()->get_name() + " ";
    const std::string unknown = unknown_words(*chosen.front());
    if (!unknown.empty()) what = chosen.front()->get_name() + ": " + unknown;
  } else {
    const auto unknown = program.remaining();
    std::string verbs;
    std::vector<std::string> words;
    for (const CLI::App* known : program.get_subcommands({})) {
      words.push_back(known->get_name());
      verbs += (verbs.empty() ? "" : ", ") + known->get_name();
    }
    if (unknown.empty()) {
      what = "give a verb; to begin: " + name + " try";
    } else if (unknown.front().starts_with('-')) {
      what = "there is no option '" + unknown.front() + "' before the verb";
    } else {
      what = "there is no verb '" + unknown.front() + "'";
      const std::string hint = did_you_mean(unknown.front(), words);
      what += hint.empty() ? "; the verbs are " + verbs : hint;
    }
  }
  return end();
}

std::string g_program;  // its name, set before anything can end it

void say_without_memory(std::string_view text) {
  if (::write(STDERR_FILENO, text.data(), text.size()) < 0) return;  // nobody is there to read it
}

/// Ends the program with a message when memory runs out in code that must not throw (the destructor
/// of a large Json allocates).
[[noreturn]] void end_without_memory() noexcept {
  try {
    if (const auto thrown = std::current_exception()) std::rethrow_exception(thrown);
  } catch (const std::bad_alloc&) {
    say_without_memory(g_program);
    say_without_memory(": ");
    say_without_memory(out_of_memory().message);
    say_without_memory("\n");
    std::_Exit(kInputAtFault);
  } catch (...) {
  }
  std::abort();
}

/// Refuses empty values: mostly unset variables of a script. Taken as options that were not given,
/// they would silently leave out the robot, the path or the settings.
const CLI::Option* empty_option(const CLI::App& verb) {
  for (const CLI::Option* option : verb.get_options()) {
    if (option->count() == 0 || option->get_expected_min() == 0) continue;
    for (const std::string& text : option->results()) {
      if (text.empty()) return option;
    }
  }
  return nullptr;
}

}  // namespace

void add_common_options(CLI::App& program) {
  use_help_text(program);
  program.set_version_flag("-v,--version", program.get_name() + " " PALPATE_VERSION,
                           "Print the version and exit");
  program
      .add_flag_callback(
          "--licenses", [] { throw CLI::CallForVersion(license_notices(), 0); },
          "Print third-party notices and exit")
      ->configurable(false);
  add_quiet_flag(program);
}

void add_quiet_flag(CLI::App& app) {
  app.add_flag_callback("--quiet", set_quiet, "Print errors only, and results asked for by --json")
      ->trigger_on_parse();
}

int run_program(CLI::App& program, const Action& action, int argc, char** argv) {
  const std::string& name = program.get_name();
  g_program = name;
  (void)out_of_memory();  // while there is some
  std::set_terminate(end_without_memory);
  try {
    program.parse(argc, argv);
  } catch (const CLI::Success& help_or_version) {
    const int status = program.exit(help_or_version);
    if (!std::cout.flush()) return fail(name, "cannot write to the standard output", kInputAtFault);
    return status;
  } catch (const CLI::ParseError& error) {
    return fail_usage(program, error);
  }
  for (const CLI::App* verb : program.get_subcommands()) {
    const CLI::Option* const option = empty_option(*verb);
    if (option == nullptr) continue;
    return fail(name,
                option->get_name() + ": is empty; give a value" +
                    (option->get_required() ? "" : ", or leave it out") + "; see " + name + " " +
                    verb->get_name() + " --help",
                kWrongUsage);
  }
  Status done = Done{};
  guarded([&] { done = action(); }, [&](const Error& error) { done = error; });
  if (!done) return fail(name, done.error().message, kInputAtFault);
  print_kept();
  if (!std::cout.flush()) return fail(name, "cannot write to the standard output", kInputAtFault);
  return 0;
}

}  // namespace palpate::apps
