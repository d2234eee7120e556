// palpate_eval: measures the claims of the thesis, of Palpate and of its documentation; one page.

#include <cstdio>
#include <cstdlib>
#include <iostream>
#include <memory>
#include <nlohmann/json.hpp>

#include "apps/options.h"
#include "apps/program.h"
#include "apps/terminal/terminal.h"
#include "apps/tool_info.h"
#include "eval/report/choose.h"
#include "eval/report/doc_tables.h"
#include "eval/report/report.h"
#include "eval/report/run_evaluation.h"

namespace palpate::apps {
namespace {

struct Options {
  std::vector<std::string> words;
  std::vector<eval::FigureSpec> figures;  ///< those that `words` name
  eval::EvaluationOptions evaluation;
  std::vector<std::filesystem::path> write_docs;
  bool list = false, json = false;
};

void list_figures(const Options& options) {
  if (options.json) {
    nlohmann::ordered_json list = nlohmann::ordered_json::array();
    for (const eval::FigureSpec& figure : options.figures) {
      list.push_back({{"id", figure.id},
                      {"title", figure.title},
                      {"section", figure.section},
                      {"thesis_figures", eval::figure_numbers(figure.id)},
                      {"quick", figure.is_quick}});
    }
    print_json(list);
    return;
  }
  std::string section;
  for (const eval::FigureSpec& figure : options.figures) {
    if (section != figure.section) std::cout << (section = figure.section) << "\n";
    char line[200];
    std::snprintf(line, sizeof line, "  %-14s %s%s\n", figure.id, figure.title,
                  figure.is_quick ? "" : " (full form only)");
    std::cout << line;
  }
}

/// Returns the command that makes this report again.
std::string command_of(const Options& options) {
  std::string text = "palpate_eval";
  for (const std::string& word : options.words) {
    text += word.find(' ') == std::string::npos ? " " + word : " '" + word + "'";
  }
  text += " -o " + options.evaluation.output.string();
  const eval::Settings& settings = options.evaluation.settings;
  if (settings.quick) text += " --quick";
  if (!settings.data.empty()) text += " --data " + settings.data.string();
  if (settings.backend != Backend::cpu) text += " --backend " + name_of(settings.backend);
  if (!options.evaluation.gpu_report.empty()) {
    text += " --gpu-report " + options.evaluation.gpu_report.string();
  }
  if (!settings.gpu.empty()) text += " --gpu";
  for (const auto& path : settings.gpu) text += " " + path.string();
  if (!settings.peers.empty()) text += " --peers " + settings.peers.string();
  return text;
}

void print_summary(const Options& options, const eval::Evaluation& evaluation) {
  const std::string report =
      (options.evaluation.output / eval::kReportPage).lexically_normal().string();
  if (options.json) {
    nlohmann::ordered_json json{{"report", report},
                                {"made", evaluation.num_made},
                                {"kept", evaluation.num_kept},
                                {"failed", evaluation.num_failed},
                                {"figures", nlohmann::ordered_json::array()}};
    for (const eval::ReportFigure& figure : evaluation.figures) {
      if (!figure.stored) continue;
      nlohmann::ordered_json claims = nlohmann::ordered_json::array();
      for (const eval::Claim& claim : figure.stored->result.claims) {
        claims.push_back({{"source", name_of(claim.source)},
                          {"claim", claim.claim},
                          {"measured", claim.measured},
                          {"verdict", name_of(claim.verdict)}});
      }
      json["figures"].push_back({{"id", figure.spec.id},
                                 {"current", figure.is_current},
                                 {"seconds", figure.stored->seconds},
                                 {"failure", figure.stored->failure},
                                 {"claims", std::move(claims)}});
    }
    print_json(json);
    return;
  }
  std::cout << evaluation.num_made << " figures made, " << evaluation.num_kept << " kept, "
            << evaluation.num_failed << " failed\n";
  for (const eval::Source source : eval::kSources) {
    std::cout << "  " << eval::heading_of(source) << ": " << eval::counts_words(evaluation, source)
              << "\n";
  }
  std::cout << "report: " << report << "\n";
}

/// Returns an error if the run did not make all requested figures.
Status outcome(const Options& options, const eval::Evaluation& evaluation) {
  const std::string folder = options.evaluation.output.string();
  if (evaluation.interrupted) {
    return Error{Errc::cancelled, "interrupted; " + std::to_string(evaluation.num_made) +
                                      " figures were made and are kept in " + folder +
                                      ": run the same command again to resume"};
  }
  for (const eval::ReportFigure& figure : evaluation.figures) {
    if (evaluation.num_failed == 0 || !figure.stored || !figure.is_current) continue;
    if (figure.stored->failure.empty()) continue;
    return Error{Errc::bad_input, std::to_string(evaluation.num_failed) +
                                      " figures failed, the first is " + figure.spec.id + ": " +
                                      figure.stored->failure};
  }
  return Done{};
}

Status run(const Options& options) {
  if (options.list) {
    list_figures(options);
    return Done{};
  }
  catch_interrupts();
  Progress bar("evaluating");
  eval::Watcher watcher;
  watcher.on_progress = [&](double share, const std::string& words) { bar.update(share, words); };
  watcher.keep_going = [] { return !interrupted(); };
  const auto evaluation =
      eval::run_evaluation(eval::all_figures(), options.figures, options.evaluation, watcher);
  if (!evaluation) return evaluation.error();
  for (const std::string& warning : evaluation->warnings)
    std::cerr << "palpate_eval: " << warning << "\n";
  print_summary(options, *evaluation);
  if (!options.write_docs.empty() && !evaluation->interrupted) {
    const Status written = eval::write_docs(*evaluation, options.write_docs);
    if (!written) return written;
  }
  return outcome(options, *evaluation);
}

void check(Options& options) {
  const auto chosen = eval::choose_figures(eval::all_figures(), options.words);
  if (!chosen) usage_error(chosen.error().message);
  options.figures = *chosen;
  if (options.list) return;
  if (options.evaluation.output.empty()) usage_error("give -o REPORT, a folder, or --list");
  eval::Settings& settings = options.evaluation.settings;
  if (settings.data.empty()) {
    if (const char* data = std::getenv("PALPATE_DATA"); data != nullptr) settings.data = data;
  }
  if (settings.backend == Backend::cuda) {
    if (const auto gpus = find_gpus(); !gpus) usage_error(gpus.error().message);
    std::erase_if(options.figures, [](const auto& figure) { return !figure.is_on_gpu; });
    if (options.figures.empty()) {
      usage_error("none of these figures times queries; without --backend they are made");
    }
  }
  options.evaluation.command = command_of(options);
}

void add_options(CLI::App& app, Options& options) {
  eval::Settings& settings = options.evaluation.settings;
  app.add_option("figures", options.words,
                 "figures (5.1), sections (speed) or studies (noise); default: all")
      ->type_name("FIGURE");
  app.add_option(
         "-o,--output", options.evaluation.output,
         "folder of the report: new, or an earlier report; figures that would not change are kept")
      ->type_name("REPORT");
  app.add_flag("--quick", settings.quick, "fewer steps: two minutes instead of forty-five");
  app.add_flag("--fresh", options.evaluation.fresh, "remake existing figures");
  app.add_flag("--list", options.list, "list the figures and exit");
  app.add_option("--data", settings.data,
                 "folder of real depth frames; default: the environment variable PALPATE_DATA")
      ->check(CLI::Validator(CLI::ExistingDirectory).description(""))
      ->type_name("DIR");
  app.add_option(
         "--gpu", settings.gpu,
         "times of GPUs, written by scripts/gpu_check.sh, older files first; a figure takes "
         "the newest rows that have all it needs")
      ->check(CLI::Validator(CLI::ExistingFile).description(""))
      ->type_name("FILE.csv...");
  app.add_option("--gpu-report", options.evaluation.gpu_report,
                 "folder data of a report made with --backend cuda on a machine with a GPU, to "
                 "show beside this one")
      ->check(CLI::Validator(CLI::ExistingDirectory).description(""))
      ->type_name("DIR");
  add_word(app, "--backend", settings.backend,
           "where the figures that time queries make them; cuda: only those are made");
  app.add_option("--peers", settings.peers, "times of other libraries")
      ->check(CLI::Validator(CLI::ExistingFile).description(""))
      ->type_name("FILE.csv");
  app.add_option("--threads", settings.num_threads,
                 "threads for work that is not timed; default: one per core")
      ->check(CLI::Range(0, 1024).description(""))
      ->type_name("NUMBER");
  app.add_option("--commit", options.evaluation.commit, "commit of the source, shown in the report")
      ->type_name("NAME");
  app.add_option("--golden", options.evaluation.golden,
                 "hash of the program's arithmetic (tools/check_evaluation.py --hash), shown in "
                 "docs/evaluation.md")
      ->type_name("HASH");
  app.add_option("--write-docs", options.write_docs,
                 "also update the tables in these documents that quote them; of a folder, all its "
                 "documents, with claims and verdicts in its evaluation.md")
      ->check(CLI::Validator(CLI::ExistingPath).description(""))
      ->type_name("PATH...");
  app.add_flag("--json", options.json, "print the summary, or the list, as JSON");
  app.footer(
      "Example: palpate_eval -o report\n"
      "Example: palpate_eval 5.1 quality -o report --quick --data frames/\n"
      "palpate eval does the same where both programs lie in one folder.");
}

}  // namespace
}  // namespace palpate::apps

int main(int argc, char** argv) {
  CLI::App program("Make the figures of the thesis again and check each of its claims.",
                   "palpate_eval");
  palpate::apps::add_common_options(program);
  palpate::apps::Options options;
  palpate::apps::add_options(program, options);
  palpate::apps::Action action;
  program.callback([&] {
    palpate::apps::check(options);
    action = [&] { return palpate::apps::run(options); };
  });
  return palpate::apps::run_program(program, action, argc, argv);
}
