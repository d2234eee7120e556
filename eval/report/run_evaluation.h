// Makes the missing figures, one after the other, and writes the report.
#pragma once

#include <filesystem>
#include <functional>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "eval/context.h"
#include "eval/figure.h"
#include "eval/report/store.h"

namespace palpate::eval {

struct EvaluationOptions {
  Settings settings;
  std::filesystem::path output;      ///< new, empty, or an earlier report
  std::filesystem::path gpu_report;  ///< data of a report made with Backend::cuda; may be empty
  bool fresh = false;                ///< makes existing figures again
  std::string commit;                ///< of the source, for humans; may be empty
  std::string golden;                ///< hash of tests/contact/golden.txt; may be empty
  std::string command;               ///< command that makes this report
};

/// A figure of the report with its stored result.
struct ReportFigure {
  FigureSpec spec;
  std::optional<StoredFigure> stored;  ///< nullopt: not made yet
  bool is_current = false;             ///< made by this program with these settings and data
  std::optional<StoredFigure> on_gpu;  ///< queries timed on the GPU of another machine
};

struct Evaluation {
  Key key;
  std::string commit, golden, command, finished;   ///< `finished`: UTC
  std::vector<ReportFigure> figures;               ///< all figures, in the order of the report
  int num_made = 0, num_kept = 0, num_failed = 0;  ///< of the requested figures
  bool interrupted = false;
  std::vector<std::string> warnings;  ///< files that could not be used
};

/// Progress callback (`share` of the whole work, text); it may stop the work.
struct Watcher {
  std::function<void(double share, const std::string& words)> on_progress;
  std::function<bool()> keep_going;
};

/// Makes the figures `chosen` of `all`, keeps those whose file is current, and writes
/// OUTPUT/index.html from all available ones. A failed figure is reported, and the others go on.
/// Error: the folder holds something else or cannot be written.
Result<Evaluation> run_evaluation(std::span<const FigureSpec> all,
                                  std::span<const FigureSpec> chosen,
                                  const EvaluationOptions& options, const Watcher& watcher);

}  // namespace palpate::eval
