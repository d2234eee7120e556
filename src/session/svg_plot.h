// Plots as inline SVG. Colours come from classes (series1 ... series4, grid, axis, limit, ...) that
// the page defines for light and dark.
#pragma once

#include <string>
#include <vector>

namespace palpate {

struct PlotLine {
  std::string label;
  std::string css_class;
  std::vector<double> y;  ///< beside TimePlot::x; not finite: a gap
};

/// Curves over time.
struct TimePlot {
  std::string y_label;
  std::vector<double> x;  ///< ascending
  std::vector<PlotLine> lines;
  std::vector<double> events;  ///< short strokes at the top
  double limit = 0;            ///< dashed horizontal line; 0: none
  std::string limit_label;
  double right_factor = 0;  ///< second axis: y times this; 0: none
  std::string right_label;
  double marked_x = -1;  ///< dashed vertical line; negative: none
  bool log_y = false;    ///< needs positive values
};
std::string draw(const TimePlot& plot);

struct Marker {
  double value = 0;
  std::string label;
};

/// Counts in logarithmic bins, on a logarithmic axis as well: rare values stay visible.
struct LogHistogram {
  std::vector<double> values;  ///< positive
  std::string x_label;
  std::vector<Marker> markers;
};
std::string draw(const LogHistogram& histogram);

/// A number for people: at most `digits` significant digits, no trailing zeros.
std::string short_number(double value, int digits = 4);
/// Text with &, <, > and quotes escaped.
std::string escape_html(const std::string& text);

}  // namespace palpate
