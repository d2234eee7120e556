// palpate: feel what a depth camera sees, from the command line.

#include <CLI/CLI.hpp>
#include <iostream>
#include <string>

#include "apps/manual.h"
#include "apps/verbs.h"
#include "palpate/version.h"

namespace {

constexpr int kInputAtFault = 1, kWrongUsage = 2;

/// Length of the UTF-8 character at `at`, 0 if these bytes are none.
std::size_t utf8_length(const std::string& text, std::size_t at) {
  const auto byte = [&](std::size_t i) { return static_cast<unsigned char>(text[i]); };
  const std::size_t length = byte(at) < 0x80       ? 1
                             : byte(at) >> 5 == 6  ? 2
                             : byte(at) >> 4 == 14 ? 3
                             : byte(at) >> 3 == 30 ? 4
                                                   : 0;
  if (at + length > text.size()) return 0;
  for (std::size_t i = 1; i < length; ++i) {
    if (byte(at + i) >> 6 != 2) return 0;
  }
  return length;
}

/// One printable line, even if the message quotes a file that is not text.
int fail(const std::string& message, int status) {
  std::string line = "palpate: ";
  for (std::size_t at = 0; at < message.size();) {
    const std::size_t length = utf8_length(message, at);
    const auto first = static_cast<unsigned char>(message[at]);
    if (length == 0 || (length == 1 && (first < 0x20 || first == 0x7f))) {
      line += first == '\n' ? ' ' : '?';
      ++at;
    } else {
      line.append(message, at, length);
      at += length;
    }
  }
  std::cerr << line << std::endl;
  return status;
}

/// One line for a command line that cannot be understood.
int fail_usage(const CLI::App& program, const CLI::ParseError& error) {
  std::string what = error.what(), verb;
  if (const auto chosen = program.get_subcommands(); !chosen.empty()) {
    verb = chosen.front()->get_name() + " ";
  } else {
    const auto unknown = program.remaining();
    std::string verbs;
    for (const CLI::App* known : program.get_subcommands({})) {
      verbs += (verbs.empty() ? "" : ", ") + known->get_name();
    }
    if (unknown.empty()) {
      what = "give a verb";
    } else {
      const bool is_option = unknown.front().starts_with('-');
      what = std::string("there is no ") + (is_option ? "option '" : "verb '") + unknown.front() +
             (is_option ? "' before the verb" : "'");
    }
    what += "; the verbs are " + verbs;
  }
  return fail(what + "; see palpate " + verb + "--help", kWrongUsage);
}

}  // namespace

int main(int argc, char** argv) {
  CLI::App program(
      "Feel what a depth camera sees: how much of a rigid tool lies in the scene, and "
      "the wrench that follows.",
      "palpate");
  program.set_version_flag("--version", "palpate " PALPATE_VERSION);
  program
      .add_flag_callback(
          "--licenses", [] { throw CLI::CallForVersion(palpate::apps::license_notices(), 0); },
          "Print what others ask us to say about their work in this program and exit")
      ->configurable(false);
  program.require_subcommand(1);
  program.footer(
      "palpate VERB --help tells more. SI units; camera frame: x right, y down, z forward.\n"
      "Exit status: 0 ok, 1 the input or environment is at fault, 2 wrong usage.");
  palpate::apps::Action action;
  palpate::apps::add_shape(program, action);
  palpate::apps::add_pack(program, action);
  palpate::apps::add_info(program, action);
  palpate::apps::add_export(program, action);
  palpate::apps::add_query(program, action);
  palpate::apps::add_touch(program, action);
  palpate::apps::add_replay(program, action);
  palpate::apps::add_view(program, action);
  palpate::apps::add_scenes(program, action);
  palpate::apps::add_record(program, action);
  palpate::apps::add_cameras(program, action);
  palpate::apps::add_devices(program, action);
#ifdef PALPATE_EVAL
  palpate::apps::add_eval(program, action);
#endif
  program
      .add_option_function<std::string>(
          "--write-manual",
          [&program](const std::string& folder) {
            const palpate::Status status = palpate::apps::write_manual(program, folder);
            if (!status) throw CLI::ParseError(status.error().message, kInputAtFault);
            throw CLI::CallForVersion(folder, 0);
          },
          "Manual pages and completion into a folder, for packages")
      ->group("");
  try {
    program.parse(argc, argv);
  } catch (const CLI::Success& help_or_version) {
    const int status = program.exit(help_or_version);
    if (!std::cout.flush()) return fail("cannot write to the standard output", kInputAtFault);
    return status;
  } catch (const CLI::ParseError& error) {
    return fail_usage(program, error);
  }
  try {
    if (const palpate::Status status = action(); !status) {
      return fail(status.error().message, kInputAtFault);
    }
  } catch (const std::bad_alloc&) {
    return fail("out of memory: use fewer spheres, a smaller image or a shorter run",
                kInputAtFault);
  }
  if (!std::cout.flush()) return fail("cannot write to the standard output", kInputAtFault);
  return 0;
}
