// palpate: feel what a depth camera sees, from the command line.

#include <CLI/CLI.hpp>
#include <iostream>
#include <string>

#include "apps/verbs.h"

namespace {

constexpr int kInputAtFault = 1, kWrongUsage = 2;

/// One line, whatever the message holds.
int fail(std::string message, int status) {
  for (char& c : message) {
    if (c == '\n' || c == '\r') c = ' ';
  }
  while (!message.empty() && message.back() == ' ') message.pop_back();
  std::cerr << "palpate: " << message << std::endl;
  return status;
}

}  // namespace

int main(int argc, char** argv) {
  CLI::App program(
      "Feel what a depth camera sees: how much of a rigid tool lies in the scene, and "
      "the wrench that follows.",
      "palpate");
  program.set_version_flag("--version", "palpate " PALPATE_VERSION);
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
  try {
    program.parse(argc, argv);
  } catch (const CLI::Success& help_or_version) {
    return program.exit(help_or_version);
  } catch (const CLI::ParseError& error) {
    return fail(std::string(error.what()) + "; see palpate --help", kWrongUsage);
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
