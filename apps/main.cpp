// palpate: feel what a depth camera sees, from the command line.

#include <unistd.h>

#include <CLI/CLI.hpp>
#include <cstdio>
#include <iostream>
#include <string>

#include "apps/program.h"
#include "apps/verbs.h"
#include "src/core/internal/bounded_call.h"

// Exceptions are mistakes in the options of a verb, which end the program.
// NOLINTNEXTLINE(bugprone-exception-escape)
int main(int argc, char** argv) {
  CLI::App program(
      "Feel what a depth camera sees: how much of a rigid tool lies in the scene, and "
      "the resulting wrench.",
      "palpate");
  palpate::apps::add_common_options(program);
  program.require_subcommand(1);
  program.footer(
      "palpate VERB --help explains each verb. SI units; camera frame: x right, y down, z "
      "forward.\n"
      "Exit status: 0 ok, 1 the input or environment is at fault, 2 wrong usage.");
  palpate::apps::Action action;
  palpate::apps::add_shape(program, action);
  palpate::apps::add_pack(program, action);
  palpate::apps::add_info(program, action);
  palpate::apps::add_export(program, action);
  palpate::apps::add_query(program, action);
  palpate::apps::add_touch(program, action);
  palpate::apps::add_ros2(program, action);
  palpate::apps::add_replay(program, action);
  palpate::apps::add_view(program, action);
  palpate::apps::add_scenes(program, action);
  palpate::apps::add_record(program, action);
  palpate::apps::add_calibrate(program, action);
  palpate::apps::add_cameras(program, action);
  palpate::apps::add_devices(program, action);
  palpate::apps::add_eval(program, action);
  program
      .add_option_function<std::string>(
          "--write-manual",
          [&program](const std::string& folder) {
            const palpate::Status status = palpate::apps::write_manual(program, folder);
            if (!status)
              throw CLI::ParseError(status.error().message, palpate::apps::kInputAtFault);
            throw CLI::CallForVersion(folder, 0);
          },
          "Manual pages and completion into a folder, for packages")
      ->group("");
  const int status = palpate::apps::run_program(program, action, argc, argv);
  if (palpate::is_any_call_hung()) {
    std::cout.flush();
    std::fflush(nullptr);
    _exit(status);
  }
  return status;
}
