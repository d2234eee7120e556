// palpate info: prints the contents of a tool file.

#include <filesystem>
#include <iostream>
#include <memory>
#include <nlohmann/json.hpp>

#include "apps/options.h"
#include "apps/output_files.h"
#include "apps/pack/pack_robot.h"
#include "apps/tool_info.h"
#include "apps/verbs.h"
#include "palpate/io/files.h"
#include "src/io/internal/atomic_file.h"
#include "src/session/internal/packing_report.h"

namespace palpate::apps {
namespace {

struct Options {
  std::string tool, page;
  bool json = false;
};

Status run(const Options& options) {
  if (!options.page.empty()) {
    if (const Status status = check_output_file(options.page, OutputKind::page, options.tool);
        !status)
      return status;
  }
  if (options.page.empty() && std::filesystem::path(options.tool).extension() == ".palprobot") {
    return print_robot(options.tool, options.json);
  }
  const auto tool = load_tool(options.tool);
  if (!tool) return tool.error();
  if (!options.page.empty()) {
    const auto page = packing_page(*tool, packing_statistics(*tool));
    if (!page) return page.error();
    if (const Status status = write_file_atomically(options.page, *page); !status) return status;
  }
  const Standoff gap = standoff(*tool);
  warn_of_empty_part(options.tool, *tool, gap);
  if (options.json) {
    print_json(tool_info(*tool, gap));
  } else {
    std::cout << describe(*tool, gap);
  }
  return Done{};
}

}  // namespace

void add_info(CLI::App& program, Action& action) {
  const auto options = std::make_shared<Options>();
  CLI::App& app =
      *program.add_subcommand("info", "Print the contents of a tool file or a packed robot.");
  app.add_option("tool", options->tool, "tool file, or ROBOT.palprobot")
      ->required()
      ->type_name("TOOL.palp");
  app.add_option("--report", options->page, "write an HTML page about the packing")
      ->type_name("PAGE.html");
  app.add_flag("--json", options->json, "print it as JSON");
  app.footer("Example: palpate info drill.palp --json");
  app.callback([options, &action] { action = [options] { return run(*options); }; });
}

}  // namespace palpate::apps
