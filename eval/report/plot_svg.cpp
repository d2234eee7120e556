#include "eval/report/plot_svg.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <numeric>
#include <string_view>

#include "src/session/svg_parts.h"

namespace palpate::eval {
namespace {

// The picture, in its own units; the page scales it.
constexpr double kWidth = 620, kPlotHeight = 270;
constexpr double kLeft = 64, kTop = 12, kBottom = 46, kRight = 16;
constexpr double kCharacter = 6.3, kLine = 15;  // of a label
constexpr double kWidestEndLabel = 190;
constexpr std::size_t kMostEndLabels = 9, kMostDots = 40;

constexpr std::array<std::string_view, 11> kStyles{"weighted", "simplified", "graph",  "graph-cap",
                                                   "field",    "exact",      "thesis", "other1",
                                                   "other2",   "other3",     "other4"};

/// Characters as a reader counts them.
std::size_t length_of(const std::string& utf8) {
  return static_cast<std::size_t>(
      std::count_if(utf8.begin(), utf8.end(), [](char c) { return (c & 0xC0) != 0x80; }));
}

double width_of(const std::string& text) {
  return kCharacter * static_cast<double>(length_of(text));
}

bool is_drawable(double value, bool log) { return std::isfinite(value) && (!log || value > 0); }

/// The range of all values that can be drawn, on whole ticks where `widen`. Zero is part of a
/// linear range unless the values lie far from it.
Axis axis_over(const Plot& plot, std::vector<double> Curve::*values, bool log, bool widen) {
  double low = std::numeric_limits<double>::infinity(), high = -low;
  for (const Curve& curve : plot.curves) {
    const std::size_t num = std::min(curve.x.size(), curve.y.size());
    for (std::size_t i = 0; i < num; ++i) {
      if (!is_drawable(curve.x[i], plot.log_x) || !is_drawable(curve.y[i], plot.log_y)) continue;
      low = std::min(low, (curve.*values)[i]);
      high = std::max(high, (curve.*values)[i]);
    }
  }
  if (!(low <= high)) low = log ? 1 : 0, high = log ? 10 : 1;
  if (log) {
    if (low == high) low /= 2, high *= 2;
    const double margin = widen ? std::pow(high / low, 0.04) : 1;
    return {low / margin, high * margin, 0, 0, true};
  }
  if (low == high) low -= std::abs(low) / 2 + 0.5, high += std::abs(high) / 2 + 0.5;
  if (!widen) return {low, high, 0, 0, false};
  constexpr double kFarFromZero = 0.25;
  const bool from_zero = low >= 0 && high - low > kFarFromZero * high;
  const bool to_zero = high <= 0 && high - low > -kFarFromZero * low;
  const double margin = 0.05 * (high - low);
  return {from_zero ? 0 : low - margin, to_zero ? 0 : high + margin, 0, 0, false};
}

/// Powers of ten as such, large numbers in groups of three.
std::string tick_text(double value, bool log) {
  const double size = std::abs(value);
  if (value != 0 && (size >= 1e6 || size < 1e-3)) {
    static constexpr const char* kRaised[] = {"⁰", "¹", "²", "³", "⁴", "⁵", "⁶", "⁷", "⁸", "⁹"};
    const double exponent = std::floor(std::log10(size) + 1e-9);
    const double lead = value / std::pow(10.0, exponent);
    std::string raised = exponent < 0 ? "⁻" : "";
    for (const char digit : std::to_string(std::abs(static_cast<int>(exponent)))) {
      raised += kRaised[digit - '0'];
    }
    const std::string factor = short_number(lead, 3);
    return (log && factor == "1" ? "" : factor + "·") + "10" + raised;
  }
  std::string text = short_number(value, 4);
  if (size >= 1e4 && text.find('.') == std::string::npos) {
    for (auto at = static_cast<int>(text.size()) - 3; at > (value < 0 ? 1 : 0); at -= 3) {
      text.insert(static_cast<std::size_t>(at), "\u202f");
    }
  }
  return text;
}

/// Where a curve ends, and where its name stands.
struct EndLabel {
  const Curve* curve;
  double x, y;    ///< of its last point
  double text_y;  ///< of the middle of the words
};

/// Moves names apart until none covers another, keeping their order.
void spread(std::vector<EndLabel>& labels, double top, double bottom) {
  std::stable_sort(labels.begin(), labels.end(),
                   [](const EndLabel& a, const EndLabel& b) { return a.y < b.y; });
  double free = top + kLine / 2;
  for (EndLabel& label : labels) {
    label.text_y = std::max(label.y, free);
    free = label.text_y + kLine;
  }
  double limit = bottom - kLine / 2;
  for (auto label = labels.rbegin(); label != labels.rend(); ++label) {
    label->text_y = std::min(label->text_y, limit);
    limit = label->text_y - kLine;
  }
}

/// One row of names above the plot; empty where all fit at the ends of their curves.
using LegendRow = std::vector<const Curve*>;
std::vector<LegendRow> legend_rows(const std::vector<const Curve*>& named, double width) {
  constexpr double kStroke = 38;
  std::vector<LegendRow> rows;
  double x = width;
  for (const Curve* curve : named) {
    const double needed = kStroke + width_of(curve->label);
    if (rows.empty() || x + needed > width) {
      rows.emplace_back();
      x = 0;
    }
    rows.back().push_back(curve);
    x += needed;
  }
  return rows;
}

void append_legend(std::string& svg, const std::vector<LegendRow>& rows) {
  for (std::size_t r = 0; r < rows.size(); ++r) {
    double x = kLeft;
    const double y = kTop + kLine * static_cast<double>(r) + 4;
    for (const Curve* curve : rows[r]) {
      append_line(svg, ("curve " + style_class(curve->style)).c_str(), x, y - 4, x + 20, y - 4);
      append_text(svg, x + 25, y, "start", curve->label, "label");
      x += 38 + width_of(curve->label);
    }
  }
}

void append_end_labels(std::string& svg, const std::vector<EndLabel>& labels, double x) {
  for (const EndLabel& label : labels) {
    const std::string css_class = style_class(label.curve->style);
    if (std::abs(label.text_y - label.y) > 3 || label.x < x - 12) {
      append_line(svg, ("leader " + css_class).c_str(), label.x + 3, label.y, x - 2, label.text_y);
    }
    append_text(svg, x + 2, label.text_y + 4, "start", label.curve->label,
                ("name " + css_class).c_str());
  }
}

void append_dots(std::string& svg, const Curve& curve, const Axis& x_axis, const Axis& y_axis) {
  const std::size_t num = std::min(curve.x.size(), curve.y.size());
  if (num > kMostDots || curve.style == "exact") return;
  const std::string css_class = style_class(curve.style);
  for (std::size_t i = 0; i < num; ++i) {
    if (!is_drawable(curve.x[i], x_axis.log) || !is_drawable(curve.y[i], y_axis.log)) continue;
    append(svg, "<circle class='dot %s' cx='%.1f' cy='%.1f' r='2.8'/>", css_class.c_str(),
           x_axis(curve.x[i]), y_axis(curve.y[i]));
  }
}

std::vector<EndLabel> end_labels(const std::vector<const Curve*>& named, const Axis& x_axis,
                                 const Axis& y_axis) {
  std::vector<EndLabel> labels;
  for (const Curve* curve : named) {
    for (std::size_t i = std::min(curve->x.size(), curve->y.size()); i-- > 0;) {
      if (!is_drawable(curve->x[i], x_axis.log) || !is_drawable(curve->y[i], y_axis.log)) continue;
      labels.push_back({curve, x_axis(curve->x[i]), y_axis(curve->y[i]), 0});
      break;
    }
  }
  return labels;
}

}  // namespace

std::string style_class(const std::string& style) {
  const bool is_known = std::find(kStyles.begin(), kStyles.end(), style) != kStyles.end();
  return "m-" + (is_known ? style : "other1");
}

std::string draw(const Plot& plot) {
  std::vector<const Curve*> named;
  double widest = 0;
  for (const Curve& curve : plot.curves) {
    if (curve.label.empty()) continue;
    named.push_back(&curve);
    widest = std::max(widest, width_of(curve.label));
  }
  const bool at_ends = named.size() <= kMostEndLabels && widest <= kWidestEndLabel;
  const std::vector<LegendRow> rows =
      at_ends ? std::vector<LegendRow>() : legend_rows(named, kWidth - kLeft - kRight);
  const double top = kTop + kLine * static_cast<double>(rows.size());
  const double bottom = top + kPlotHeight, height = bottom + kBottom;
  const double right = kWidth - kRight - (at_ends && widest > 0 ? widest + 8 : 0);

  Axis x_axis = axis_over(plot, &Curve::x, plot.log_x, false);
  Axis y_axis = axis_over(plot, &Curve::y, plot.log_y, true);
  x_axis.from = kLeft, x_axis.to = right;
  y_axis.from = bottom, y_axis.to = top;

  std::string svg;
  append(svg, "<svg class='plot' viewBox='0 0 %.0f %.0f' role='img'", kWidth, height);
  svg += " aria-label='" + escape_html(plot.y_label + " over " + plot.x_label) + "'>";
  for (const double x : x_axis.ticks(7)) {
    append_line(svg, "grid", x_axis(x), top, x_axis(x), bottom);
    append_text(svg, x_axis(x), bottom + 17, "middle", tick_text(x, plot.log_x));
  }
  append_text(svg, (kLeft + right) / 2, height - 8, "middle", plot.x_label, "label title");
  for (const double y : y_axis.ticks(6)) {
    append_line(svg, y == 0 ? "grid zero" : "grid", kLeft, y_axis(y), right, y_axis(y));
    append_text(svg, kLeft - 7, y_axis(y) + 4, "end", tick_text(y, plot.log_y));
  }
  append(svg,
         "<text class='label title' text-anchor='middle' transform='translate(13 %.1f) "
         "rotate(-90)'>",
         (top + bottom) / 2);
  svg += escape_html(plot.y_label) + "</text>";
  append(svg, "<rect class='axis' x='%.1f' y='%.1f' width='%.1f' height='%.1f'/>", kLeft, top,
         right - kLeft, kPlotHeight);
  for (const Curve& curve : plot.curves) {
    svg += "<g><title>" + escape_html(curve.label) + "</title>";
    append_curve(svg, style_class(curve.style), curve.x, curve.y, x_axis, y_axis);
    append_dots(svg, curve, x_axis, y_axis);
    svg += "</g>";
  }
  if (at_ends) {
    std::vector<EndLabel> labels = end_labels(named, x_axis, y_axis);
    spread(labels, top, bottom);
    append_end_labels(svg, labels, right + 6);
  } else {
    append_legend(svg, rows);
  }
  return svg + "</svg>";
}

}  // namespace palpate::eval
