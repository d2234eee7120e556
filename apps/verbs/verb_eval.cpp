// palpate eval: runs the program palpate_eval, which is beside this one, with its arguments.

#include <unistd.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <cerrno>
#include <cstring>
#include <filesystem>
#include <iostream>

#include "apps/verbs.h"

namespace palpate::apps {
namespace {

/// Becomes the program; if it is not there, --help explains where it comes from.
Status become_palpate_eval(const CLI::App& app, const std::vector<std::string>& words) {
  std::error_code error;
  const auto here = std::filesystem::read_symlink("/proc/self/exe", error).parent_path();
  std::string program = (here / "palpate_eval").string();
  std::vector<char*> arguments{program.data()};
  std::vector<std::string> kept = words;
  for (std::string& word : kept) arguments.push_back(word.data());
  arguments.push_back(nullptr);
  execv(program.c_str(), arguments.data());  // returns only if it fails
  const bool asks_for_help = std::ranges::any_of(words, [](const std::string& word) {
    return word == "--help" || word == "-h" || word == "--help-all";
  });
  if (errno == ENOENT && asks_for_help) {
    std::cout << app.help();
    return Done{};
  }
  return Error{
      errno == ENOENT ? Errc::not_found : Errc::unavailable,
      "the evaluation is the program palpate_eval, which make eval builds from the source; " +
          program + ": " + std::strerror(errno)};
}

}  // namespace

void add_eval(CLI::App& program, Action& action) {
  CLI::App& app = *program.add_subcommand(
      "eval", "Make the figures of the thesis again: runs the program palpate_eval.");
  app.set_help_flag();
  app.set_help_all_flag();
  app.prefix_command();
  app.footer("palpate_eval --help lists its options. Built by make eval; packages are without it.");
  app.callback([&app, &action] {
    action = [&app, words = app.remaining()] { return become_palpate_eval(app, words); };
  });
}

}  // namespace palpate::apps
