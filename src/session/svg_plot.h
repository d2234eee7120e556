// Plots as inline SVG. Colours come from classes (series1 ... series4, grid, axis, limit, ...) that
// the page defines for light and dark.
#pragma once

#include <string>
#include <vector>

#include "src/session/svg_parts.h"

namespace palpate {

struct PlotLine {
  std::string label;
  std::string css_class;
  std::vector<double> y;  ///< beside LinePlot::x; not finite: a gap
};

/// Curves over a common x, for example time.
struct LinePlot {
  std::string x_label, y_label;
  std::vector<double> x;  ///< ascending
  std::vector<PlotLine> lines;
  std::vector<double> events;  ///< short strokes at the top
  double limit = 0;            ///< dashed horizontal line; 0: none
  std::string limit_label;
  double right_factor = 0;  ///< second axis: y times this; 0: none
  std::string right_label;
  double marked_x = -1;  ///< dashed vertical line; negative: none
  bool log_x = false;    ///< needs positive values
  bool log_y = false;
};
std::string draw(const LinePlot& plot);

struct Marker {
  double value = 0;
  std::string label;
};

/// How the values of a histogram are counted together.
enum class Bins {
  logarithmic,    ///< positive values; both axes logarithmic: rare values stay visible
  whole_numbers,  ///< the same for counts: bins end between whole numbers
  even            ///< from zero, both axes linear
};

struct Histogram {
  Bins bins = Bins::logarithmic;
  std::vector<double> values;
  std::string x_label, y_label;
  std::vector<Marker> markers;
};
std::string draw(const Histogram& histogram);

}  // namespace palpate
