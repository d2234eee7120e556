// What every plot is made of: axes with ticks, lines and words as SVG.
#pragma once

#include <string>
#include <vector>

namespace palpate {

/// Maps [low, high] to [from, to], linearly or by logarithm.
struct Axis {
  double low, high, from, to;
  bool log = false;

  double operator()(double value) const;
  /// Values with sensible numbers: steps of 1, 2 or 5 times a power of ten; on a logarithmic axis
  /// the powers of ten, with 2 and 5 between them if they are few.
  std::vector<double> ticks(int about) const;
};

/// printf onto the end; the pieces are short.
__attribute__((format(printf, 2, 3))) void append(std::string& svg, const char* format, ...);
void append_text(std::string& svg, double x, double y, const char* anchor, const std::string& text,
                 const char* css_class = "label");
void append_line(std::string& svg, const char* css_class, double x1, double y1, double x2,
                 double y2);

/// The line through the points as a path of class "curve `css_class`"; not finite: a gap. Where
/// several successive points fall on one column of pixels, their smallest and largest stand for
/// them, in the order in which they come.
void append_curve(std::string& svg, const std::string& css_class, const std::vector<double>& x,
                  const std::vector<double>& y, const Axis& x_axis, const Axis& y_axis);

/// A number for humans: at most `digits` significant digits, no trailing zeros.
std::string short_number(double value, int digits = 4);
/// Text with &, <, > and quotes escaped.
std::string escape_html(const std::string& text);

}  // namespace palpate
