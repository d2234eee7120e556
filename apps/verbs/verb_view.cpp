// palpate view: shows a run or a tool in a browser.

#include <chrono>
#include <iostream>
#include <memory>
#include <thread>

#include "apps/page.h"
#include "apps/terminal/terminal.h"
#include "apps/verbs.h"
#include "palpate/io/files.h"
#include "palpate/viewer/viewer.h"

namespace palpate::apps {
namespace {

struct Options {
  std::string what;
  PageOptions server;
};

Status show(ViewSource& source, const Options& options) {
  catch_interrupts();  // before the address of the page is printed
  const auto page = OpenPage::serve(source, options.server, std::cout);
  if (!page) return page.error();
  while (!interrupted()) std::this_thread::sleep_for(std::chrono::milliseconds(50));
  return Done{};
}

Status run(const Options& options) {
  const std::filesystem::path path = options.what;
  std::error_code ignored;
  if (std::filesystem::is_regular_file(path, ignored)) {
    const auto tool = load_tool(path);
    if (!tool) return tool.error();
    return show(*view_tool(*tool, path.filename().string()), options);
  }
  const auto source = view_run(path);
  if (!source) return source.error();
  return show(**source, options);
}

}  // namespace

void add_view(CLI::App& program, Action& action) {
  const auto options = std::make_shared<Options>();
  CLI::App& app = *program.add_subcommand("view", "Show a run or a tool in a browser.");
  app.add_option("what", options->what, "folder of a run, or a tool file")
      ->required()
      ->type_name("RUN|TOOL.palp");
  add_page_options(app, "--", options->server);
  app.add_flag("--open", options->server.opens_browser, "also open the browser of this computer");
  app.footer(
      "Example: palpate view run1\n"
      "Example: palpate view drill.palp --port 0 --open");
  app.callback([options, &action] { action = [options] { return run(*options); }; });
}

}  // namespace palpate::apps
