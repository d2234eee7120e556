// palpate info: what is in a tool file.

#include <iostream>
#include <memory>
#include <nlohmann/json.hpp>

#include "apps/options.h"
#include "apps/tool_info.h"
#include "apps/verbs.h"
#include "palpate/io/tool_file.h"

namespace palpate::apps {
namespace {

struct Options {
  std::string tool;
  bool json = false;
};

Status run(const Options& options) {
  const auto tool = load_tool(options.tool);
  if (!tool) return tool.error();
  if (options.json) {
    print_json(tool_info(*tool));
  } else {
    std::cout << describe(*tool);
  }
  return Done{};
}

}  // namespace

void add_info(CLI::App& program, Action& action) {
  const auto options = std::make_shared<Options>();
  CLI::App& app = *program.add_subcommand("info", "Tell what is in a tool file.");
  app.add_option("tool", options->tool, "tool file")->required()->type_name("TOOL.palp");
  app.add_flag("--json", options->json, "print it as JSON");
  app.footer("Example: palpate info drill.palp --json");
  app.callback([options, &action] { action = [options] { return run(*options); }; });
}

}  // namespace palpate::apps
