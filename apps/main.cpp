// palpate: feel what a depth camera sees, from the command line.

#include <unistd.h>

#include <CLI/CLI.hpp>
#include <cstdio>
#include <iostream>
#include <string>
#include <vector>

#include "apps/program.h"
#include "apps/verbs.h"
#include "src/core/internal/bounded_call.h"

// Exceptions are mistakes in the options of a verb, which end the program.
// NOLINTNEXTLINE(bugprone-exception-escape)
int main(int argc, char** argv) {
  CLI::App program(
      "Feel what a depth camera sees: the force and torque on a rigid tool in its image.",
      "palpate");
  palpate::apps::add_common_options(program);
  program.require_subcommand(1);
  program.footer(
      "SI units; camera frame: x right, y down, z forward.\n"
      "Exit status: 0 ok, 1 the input or environment is at fault, 2 wrong usage.");
  palpate::apps::Action action;
  namespace apps = palpate::apps;
  struct Group {
    const char* name;
    std::vector<void (*)(CLI::App&, apps::Action&)> verbs;
  };
  const Group groups[] = {
      {"Begin", {apps::add_try, apps::add_help}},
      {"Tools", {apps::add_pack, apps::add_info, apps::add_export, apps::add_shape}},
      {"Contact", {apps::add_touch, apps::add_query, apps::add_ros2}},
      {"Runs", {apps::add_view, apps::add_replay, apps::add_report}},
      {"Cameras and devices",
       {apps::add_cameras, apps::add_devices, apps::add_scenes, apps::add_record,
        apps::add_calibrate}},
      {"Evaluation", {apps::add_eval}}};
  for (const auto& [name, verbs] : groups) {
    for (const auto add : verbs) add(program, action);
    for (CLI::App* verb : program.get_subcommands({})) {
      if (verb->get_group() == "Subcommands") verb->group(name);
    }
  }
  for (CLI::App* verb : program.get_subcommands({})) {
    if (!verb->get_prefix_command()) apps::add_quiet_flag(*verb);
  }
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
