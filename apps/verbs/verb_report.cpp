// palpate report: lays two runs over each other.

#include <CLI/CLI.hpp>
#include <memory>
#include <string>

#include "apps/output_files.h"
#include "apps/terminal/terminal.h"
#include "apps/verbs.h"
#include "src/io/internal/atomic_file.h"
#include "src/session/internal/run_folder.h"

namespace palpate::apps {
namespace {

struct Options {
  std::string a, b, output;
};

Status run(const Options& options) {
  if (const Status status = check_output_file(options.output, OutputKind::page); !status) {
    return status;
  }
  for (const std::string& folder : {options.a, options.b}) {
    if (is_same_file(options.output, std::filesystem::path(folder) / "report.html")) {
      return Error{Errc::io_failure, options.output + ": this is the report of " + folder +
                                         ": give another file with -o"};
    }
  }
  const auto page = two_runs_page(options.a, options.b);
  if (!page) return page.error();
  if (const Status status = write_file_atomically(options.output, *page); !status) return status;
  results() << "report: " << options.output << '\n';
  return Done{};
}

}  // namespace

void add_report(CLI::App& program, Action& action) {
  const auto options = std::make_shared<Options>();
  CLI::App& app =
      *program.add_subcommand("report", "Lay two runs over each other: one page for both.");
  app.add_option("first_run", options->a, "folder of a run")->required()->type_name("RUN");
  app.add_option("second_run", options->b, "folder of another, for example of its replay")
      ->required()
      ->type_name("RUN2");
  app.add_option("-o,--output", options->output, "the page")->required()->type_name("FILE.html");
  app.footer(
      "Example: palpate replay run1 -o run2 --method graph\n"
      "Example: palpate report run1 run2 -o both.html");
  app.callback([options, &action] { action = [options] { return run(*options); }; });
}

}  // namespace palpate::apps
