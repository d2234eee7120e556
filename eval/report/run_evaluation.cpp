#include "eval/report/run_evaluation.h"

#include <algorithm>
#include <chrono>
#include <cstdio>
#include <ctime>
#include <exception>
#include <new>
#include <string_view>

#include "eval/report/report.h"
#include "src/io/internal/atomic_file.h"

namespace palpate::eval {
namespace {

namespace fs = std::filesystem;

std::string utc_now() {
  const std::time_t now = std::time(nullptr);
  std::tm parts{};
  gmtime_r(&now, &parts);
  char text[32];
  std::strftime(text, sizeof text, "%Y-%m-%d %H:%M", &parts);
  return text;
}

/// Refuses to overwrite anything but a report.
Status check_output(const fs::path& output) {
  std::error_code error;
  if (!fs::exists(output, error)) return Done{};
  if (!fs::is_directory(output, error)) {
    return Error{Errc::io_failure, output.string() + " is not a folder: give another name"};
  }
  for (const auto& entry : fs::directory_iterator(output, error)) {
    const std::string name = entry.path().filename().string();
    if (name == kDataFolder || name == kReportPage) continue;
    return Error{Errc::io_failure, output.string() + " holds " + name +
                                       ", which is no part of a report: give another folder"};
  }
  if (error) {
    return Error{Errc::io_failure,
                 "cannot read " + output.string() + ": " + error.message() + "; give another"};
  }
  return Done{};
}

/// Makes a figure or returns the error. Lets Cancelled and std::bad_alloc pass.
Result<FigureResult> make(const FigureSpec& figure, Context& context) {
  try {
    auto result = figure.make(context);
    if (result && result->claims.empty() && result->tables.empty() && result->pictures.empty()) {
      return Error{Errc::bad_input, "it has neither a claim nor anything to show"};
    }
    return result;
  } catch (const std::bad_alloc&) {
    throw;
  } catch (const std::exception& unexpected) {
    return Error{Errc::bad_input, unexpected.what()};
  }
}

StoredFigure store(const FigureSpec& figure, const Evaluation& evaluation, Context& context) {
  StoredFigure stored;
  stored.id = figure.id;
  stored.key = evaluation.key;
  stored.commit = evaluation.commit;
  const auto start = std::chrono::steady_clock::now();
  auto result = make(figure, context);
  stored.seconds = std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
  stored.made = utc_now();
  if (result) {
    stored.result = *std::move(result);
  } else {
    stored.failure = result.error().message;
  }
  return stored;
}

bool is_among(std::span<const FigureSpec> figures, const FigureSpec& figure) {
  return std::any_of(figures.begin(), figures.end(), [&](const FigureSpec& other) {
    return std::string_view(other.id) == figure.id;
  });
}

/// Loads the stored figure from the folder; an unusable file adds a warning and counts as absent.
ReportFigure look_up(const FigureSpec& spec, const fs::path& folder, Evaluation& evaluation) {
  ReportFigure figure{spec, std::nullopt, false, std::nullopt};
  auto stored = load_figure(spec.id, folder);
  if (stored) {
    // The full form replaces the quick one too.
    Key desired = evaluation.key;
    if (stored->key.form == "full") desired.form = "full";
    figure.is_current = stored->key == desired;
    figure.stored = *std::move(stored);
  } else if (stored.error().code != Errc::not_found) {
    evaluation.warnings.push_back(stored.error().message);
  }
  return figure;
}

/// Makes the figures that are missing or outdated.
Status make_missing(std::span<const FigureSpec> chosen, const EvaluationOptions& options,
                    const Watcher& watcher, Evaluation& evaluation) {
  std::vector<ReportFigure*> missing;
  for (ReportFigure& figure : evaluation.figures) {
    if (!is_among(chosen, figure.spec)) continue;
    if (options.settings.quick && !figure.spec.is_quick) continue;
    // A failed figure is made again.
    const bool is_there = figure.is_current && figure.stored->failure.empty();
    if (is_there && !options.fresh) {
      ++evaluation.num_kept;
    } else {
      missing.push_back(&figure);
    }
  }
  Context context(options.settings);
  context.keep_going = watcher.keep_going;
  for (std::size_t i = 0; i < missing.size(); ++i) {
    ReportFigure& figure = *missing[i];
    const std::string words = std::string(figure.spec.id) + " " + figure.spec.title;
    context.on_progress = [&](double share) {
      if (!watcher.on_progress) return;
      watcher.on_progress((static_cast<double>(i) + std::clamp(share, 0.0, 1.0)) /
                              static_cast<double>(missing.size()),
                          words);
    };
    try {
      context.progress(0);
      StoredFigure stored = store(figure.spec, evaluation, context);
      const Status saved = save_figure(stored, options.output / kDataFolder);
      if (!saved) return saved;
      stored.failure.empty() ? ++evaluation.num_made : ++evaluation.num_failed;
      figure.stored = std::move(stored);
      figure.is_current = true;
    } catch (const Cancelled&) {
      evaluation.interrupted = true;
      break;
    }
  }
  return Done{};
}

}  // namespace

namespace {

/// Makes the README of the folder of data, readable without this repository.
std::string data_readme(const Evaluation& evaluation) {
  std::string text =
      "# Data of the evaluation\n\n"
      "Made by `" +
      evaluation.command + "`" +
      (evaluation.commit.empty() ? "" : ", commit " + evaluation.commit) + ", " +
      evaluation.finished + " UTC, on " + evaluation.key.processor + ", " + evaluation.key.isa +
      "; real frames " + evaluation.key.data +
      ".\n\n"
      "Of each figure:\n\n"
      "* `ID.json`: all of it, with what it was made with, its claims, what was measured and the "
      "verdicts.\n"
      "* `ID-numbers.csv`: key, value, unit of every number; keys are the same in every run.\n"
      "* `ID-plotN.csv`: the curves of plot N, one point a line.\n"
      "* `ID-tableN.csv`: table N as it is on the page.\n\n"
      "An empty value was not measured. Volumes and forces in % are shares of the whole tool; the "
      "notes in the JSON say how a figure was made. The same program, form, machine and recorded "
      "frames give the same numbers, but for times.\n\n"
      "| figure | title | made | seconds |\n|---|---|---|---|\n";
  for (const ReportFigure& figure : evaluation.figures) {
    if (!figure.stored) continue;
    char seconds[32];
    std::snprintf(seconds, sizeof seconds, "%.0f", figure.stored->seconds);
    text += "| " + std::string(figure.spec.id) + " | " + figure.spec.title + " | " +
            figure.stored->made + " | " + seconds + " |\n";
  }
  return text;
}

}  // namespace

Result<Evaluation> run_evaluation(std::span<const FigureSpec> all,
                                  std::span<const FigureSpec> chosen,
                                  const EvaluationOptions& options, const Watcher& watcher) {
  if (Status status = check_output(options.output); !status) return status.error();
  Evaluation evaluation;
  evaluation.key = key_of(options.settings);
  evaluation.commit = options.commit;
  evaluation.golden = options.golden;
  evaluation.command = options.command;
  for (const FigureSpec& spec : all) {
    evaluation.figures.push_back(look_up(spec, options.output / kDataFolder, evaluation));
    if (options.gpu_report.empty() || !spec.is_on_gpu) continue;
    auto on_gpu = load_figure(spec.id, options.gpu_report);
    if (on_gpu && on_gpu->failure.empty()) {
      evaluation.figures.back().on_gpu = *std::move(on_gpu);
    } else if (!on_gpu && on_gpu.error().code != Errc::not_found) {
      evaluation.warnings.push_back(on_gpu.error().message);
    }
  }
  if (Status status = make_missing(chosen, options, watcher, evaluation); !status) {
    return status.error();
  }
  evaluation.finished = utc_now();
  std::error_code ignored;
  fs::create_directories(options.output / kDataFolder, ignored);
  const auto page = evaluation_page(evaluation);
  if (!page) {
    evaluation.warnings.push_back(page.error().message);
  } else if (Status status = write_file_atomically(options.output / kReportPage, *page); !status) {
    return status.error();
  }
  const Status described =
      write_file_atomically(options.output / kDataFolder / "README.md", data_readme(evaluation));
  if (!described) return described.error();
  return evaluation;
}

}  // namespace palpate::eval
