// One figure of the evaluation: what the thesis claims, what we measured, and whether they agree.
#pragma once

#include <array>
#include <functional>
#include <span>
#include <string>
#include <vector>

#include "palpate/core/result.h"

namespace palpate::eval {

/// What our numbers say of a claim of the thesis.
enum class Verdict {
  agrees,        ///< the same finding
  better,        ///< the claim's point is met and passed
  differs,       ///< another finding, with the reason beside it
  contradicts,   ///< the claim is wrong, or our docs are
  not_measured,  ///< what it takes is not on this machine; says what
};
constexpr auto names_of(Verdict) {
  return std::array{"agrees", "better", "differs", "contradicts", "not measured"};
}

/// A claim and what came of it, each one sentence with its numbers.
struct Claim {
  std::string thesis, ours;
  Verdict verdict = Verdict::agrees;
};

/// One curve. `style` gives the colour, the same in every figure: a method (weighted, simplified,
/// graph, graph-cap, field), "exact" (dashed), "thesis", or "other1" ... "other4".
struct Curve {
  std::string label, style;
  std::vector<double> x, y;  ///< of one length; not finite: a gap
};

struct Plot {
  std::string title, x_label, y_label;  ///< labels with units
  std::vector<Curve> curves;
  bool log_x = false, log_y = false;
  std::string caption;  ///< the finding, one sentence
};

/// A number that texts may quote: `key` is unique in its figure, e.g. "field.jump_ratio.noisy".
struct Number {
  std::string key;
  double value = 0;
  std::string unit;
};

struct Table {
  std::string title;
  std::vector<std::string> columns;
  std::vector<std::vector<std::string>> rows;
};

/// What running a figure gives.
struct FigureResult {
  std::vector<Claim> claims;
  std::vector<Plot> plots;
  std::vector<Table> tables;
  std::vector<Number> numbers;
  std::vector<std::string> notes;  ///< how it was made, what is missing
};

class Context;

/// A figure that can be made.
struct FigureSpec {
  const char* id;       ///< as on the command line: "3.3", "5.17-5.19", "noise"
  const char* title;    ///< what is compared
  const char* section;  ///< of the report: "Speed", "Quality", "Time", "Robustness", "Peers",
                        ///< "Drawings"
  /// Errors only where going on makes no sense; data that are not there are `not_measured`.
  Result<FigureResult> (*make)(Context& context);
  bool is_quick = true;  ///< made by the quick form too, with fewer steps
};

/// All of them, in the order of the report. Each group lies in its own file.
std::vector<FigureSpec> all_figures();
std::vector<FigureSpec> speed_figures();       // 3.3, 3.9, 3.10, 5.1-5.6, 4.2, 4.3
std::vector<FigureSpec> recorded_figures();    // 3.4-3.6, 3.11, 5.7-5.16
std::vector<FigureSpec> synthetic_figures();   // 5.17-5.19, 5.21-5.29
std::vector<FigureSpec> accuracy_figures();    // every method against the exact wrench: accuracy
std::vector<FigureSpec> option_figures();      // continuity, bodies, fill
std::vector<FigureSpec> edge_figures();        // 3.12-3.14, edges
std::vector<FigureSpec> silhouette_figures();  // silhouettes
std::vector<FigureSpec> time_figures();        // 3.15, 3.16
std::vector<FigureSpec> frame_figures();       // frames
std::vector<FigureSpec> robustness_figures();  // noise, missing, distance, resolution, packing
std::vector<FigureSpec> response_figures();    // the 6-DOF collision-response benchmark
std::vector<FigureSpec> peer_figures();        // other libraries
std::vector<FigureSpec> drawings();            // 3.1, 3.2, 3.7, 3.8, 4.1, 4.4-4.8, 5.17, 5.20

}  // namespace palpate::eval
