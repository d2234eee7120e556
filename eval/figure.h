// One figure of the evaluation: what the thesis claims, what we measured, and whether they agree.
#pragma once

#include <array>
#include <functional>
#include <span>
#include <string>
#include <vector>

#include "palpate/core/core.h"

namespace palpate::eval {

/// Source of a claim; it determines the possible verdicts.
enum class Source {
  thesis,  ///< its methods, built as printed and corrected, show the claimed result
  ours,    ///< ours is better than the methods of the thesis, or than another library
  docs,    ///< ours meets its documentation or its goals
};
constexpr auto names_of(Source) { return std::array{"thesis", "ours", "docs"}; }

enum class Verdict {
  agrees,          ///< thesis: the same finding
  differs,         ///< thesis: only a part of it
  contradicts,     ///< thesis: the opposite
  not_comparable,  ///< thesis: different machine or setup; says why
  better,          ///< ours: by more than a tenth
  even,            ///< ours
  worse,           ///< ours: by more than a tenth
  holds,           ///< docs
  holds_in_part,   ///< docs
  fails,           ///< docs
  not_measured,    ///< needs something that this machine lacks; says what
};
constexpr auto names_of(Verdict) {
  return std::array{"agrees", "differs", "contradicts",   "not comparable", "better",      "even",
                    "worse",  "holds",   "holds in part", "fails",          "not measured"};
}
/// Returns the source of a verdict. Any source may have `not_measured`: its claim names the source.
constexpr Source source_of(Verdict verdict) {
  if (verdict <= Verdict::not_comparable || verdict == Verdict::not_measured) return Source::thesis;
  return verdict <= Verdict::worse ? Source::ours : Source::docs;
}

/// A claim and its result, each one sentence with its numbers.
struct Claim {
  std::string claim, measured;
  Verdict verdict = Verdict::agrees;
  Source source = source_of(verdict);
};

/// One curve. `style` gives the color, the same in every figure: a method (weighted, simplified,
/// graph, graph-cap, field), "exact" (dashed), "thesis", or "other1" ... "other4".
struct Curve {
  std::string label, style;
  std::vector<double> x, y;  ///< of equal length; not finite: a gap
};

struct Plot {
  std::string title, x_label, y_label;  ///< labels with units
  std::vector<Curve> curves;
  bool log_x = false, log_y = false;
  std::string caption;  ///< the finding, one sentence
};

/// A number for texts to quote: `key` is unique in its figure, e.g. "field.jump_ratio.noisy".
struct Number {
  std::string key;
  double value = 0;
  std::string unit;
};

/// A picture in three dimensions; drawn, not measured.
struct Picture {
  enum class Kind { cut_open, seen } kind;
  std::string title;
  std::string data;  ///< JSON: solid_json of a tool cut open across z, or seen_tool_json
  std::string caption;
};
constexpr auto names_of(Picture::Kind) { return std::array{"cut open", "seen"}; }

struct Table {
  std::string title;
  std::vector<std::string> columns;
  std::vector<std::vector<std::string>> rows;
};

/// Result of a figure: claims, or only tables and pictures for a drawing.
struct FigureResult {
  std::vector<Claim> claims;
  std::vector<Plot> plots;
  std::vector<Table> tables;
  std::vector<Picture> pictures;
  std::vector<Number> numbers;
  std::vector<std::string> notes;  ///< method of measurement, missing data
  std::string rows_of;             ///< machine and commit of times from a file; empty: this run
};

class Context;

/// A figure to be made.
struct FigureSpec {
  const char* id;       ///< as on the command line: "3.3", "5.17-5.19", "noise"
  const char* title;    ///< what is compared
  const char* section;  ///< of the report: "Speed", "Quality", "Time", "Robustness", "Real data",
                        ///< "Peers", "Drawings"
  /// Errors only if the figure makes no sense otherwise; absent data are `not_measured`.
  Result<FigureResult> (*make)(Context& context);
  bool is_quick = true;    ///< included in the quick form, with fewer steps
  bool is_on_gpu = false;  ///< times its queries on Settings::backend
};

/// All figures, in the order of the report. Each group lies in its own file.
std::vector<FigureSpec> all_figures();
std::vector<FigureSpec> speed_figures();       // 3.3, 3.9, 3.10, 5.1-5.6, 4.2, 4.3
std::vector<FigureSpec> recorded_figures();    // 3.4-3.6, 3.11, 5.7-5.16
std::vector<FigureSpec> protocol_figures();    // a moving hand, recorded and replayed: protocol
std::vector<FigureSpec> synthetic_figures();   // 5.17-5.19, 5.21-5.29
std::vector<FigureSpec> accuracy_figures();    // every method against the exact wrench: accuracy
std::vector<FigureSpec> option_figures();      // continuity, bodies, fill, graphs, ...
std::vector<FigureSpec> edge_figures();        // 3.12-3.14, edges
std::vector<FigureSpec> silhouette_figures();  // silhouettes
std::vector<FigureSpec> time_figures();        // 3.15, 3.16
std::vector<FigureSpec> frame_figures();       // frames
std::vector<FigureSpec> robustness_figures();  // noise, missing, distance, resolution, packing
std::vector<FigureSpec> rig_figures();         // two cameras, one of them off: misplaced
std::vector<FigureSpec> cube_figures();        // a recorded cube: cube, cube-world, cube-tracked
std::vector<FigureSpec> flat_figures();        // recorded frames where they are flat
std::vector<FigureSpec> response_figures();    // the 6-DOF collision-response benchmark
std::vector<FigureSpec> peer_figures();        // other libraries
std::vector<FigureSpec> drawings();            // 3.1, 3.2, 3.7, 3.8, 4.1, 4.4-4.8, 5.17, 5.20

}  // namespace palpate::eval
