#include "src/session/svg_plot.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <limits>

#include "src/session/svg_parts.h"

namespace palpate {
namespace {

// The picture, in its own units; the page scales it.
constexpr double kWidth = 900, kHeight = 250;
constexpr double kLeft = 66, kRight = 66, kTop = 26, kBottom = 40;
constexpr double kPlotWidth = kWidth - kLeft - kRight, kPlotHeight = kHeight - kTop - kBottom;

void append_side_label(std::string& svg, double x, const std::string& text) {
  append(svg,
         "<text class='label' text-anchor='middle' transform='translate(%.1f %.1f) rotate(-90)'>",
         x, kTop + kPlotHeight / 2);
  svg += escape_html(text) + "</text>";
}

/// Range of all finite values, widened to whole ticks; 0 is part of a linear range.
Axis value_axis(const LinePlot& plot) {
  double low = plot.log_y ? std::numeric_limits<double>::infinity() : 0, high = 0;
  for (const PlotLine& line : plot.lines) {
    for (const double y : line.y) {
      if (!std::isfinite(y) || (plot.log_y && y <= 0)) continue;
      low = std::min(low, y);
      high = std::max(high, y);
    }
  }
  Axis axis{low, high, kTop + kPlotHeight, kTop, plot.log_y};
  if (plot.log_y) {
    if (!(high > 0)) axis.low = 1, axis.high = 10;
    axis.high = std::max(axis.high, plot.limit);
    axis.low = std::pow(10.0, std::floor(std::log10(axis.low)));
    axis.high = std::pow(10.0, std::ceil(std::log10(axis.high * 1.01)));
    return axis;
  }
  if (!(high > low)) axis.high = low + 1;
  const double margin = 0.06 * (axis.high - axis.low);
  axis.high += margin;
  if (axis.low < 0) axis.low -= margin;
  return axis;
}

std::string open_svg(const std::string& title) {
  std::string svg;
  append(svg, "<svg viewBox='0 0 %.0f %.0f' role='img'", kWidth, kHeight);
  return svg + " aria-label='" + escape_html(title) + "'>";
}

void append_frame(std::string& svg) {
  append(svg, "<rect class='axis' x='%.1f' y='%.1f' width='%.1f' height='%.1f'/>", kLeft, kTop,
         kPlotWidth, kPlotHeight);
}

void append_legend(std::string& svg, const LinePlot& plot) {
  double x = kLeft;
  const auto entry = [&](const std::string& css_class, const std::string& label) {
    append(svg, "<line class='curve %s' x1='%.1f' y1='12' x2='%.1f' y2='12'/>", css_class.c_str(),
           x, x + 18);
    append_text(svg, x + 23, 16, "start", label);
    x += 40 + 7.2 * static_cast<double>(label.size());
  };
  for (const PlotLine& line : plot.lines) entry(line.css_class, line.label);
  if (!plot.events.empty()) entry("event", "new depth frame");
  if (plot.marked_x >= 0) entry("marked", "deepest moment");
}

/// Ends of bins that hold all values and markers, ascending; at least one bin.
std::vector<double> bin_edges(const Histogram& histogram) {
  const bool log = histogram.bins != Bins::even;
  double low = std::numeric_limits<double>::infinity(), high = 0;
  const auto widen = [&](double value) {
    if (log && !(value > 0)) return;
    low = std::min(low, value);
    high = std::max(high, value);
  };
  for (const double value : histogram.values) widen(value);
  for (const Marker& marker : histogram.markers) widen(marker.value);
  if (!(high > 0)) low = 1, high = 10;
  std::vector<double> edges;
  if (histogram.bins == Bins::even) {
    constexpr int kNumBins = 80;
    for (int b = 0; b <= kNumBins; ++b) edges.push_back(1.02 * high * b / kNumBins);
  } else if (histogram.bins == Bins::whole_numbers) {
    constexpr double kGrowth = 1.12;
    edges.push_back(0.5);
    while (edges.back() <= high) {
      edges.push_back(std::max(edges.back() + 1, std::floor(edges.back() * kGrowth) + 0.5));
    }
  } else {
    constexpr int kBinsPerDecade = 25;
    const double first = std::floor(std::log10(low) * kBinsPerDecade) - 1;
    const double last = std::floor(std::log10(high) * kBinsPerDecade) + 2;
    for (double bin = first; bin <= last; ++bin) {
      edges.push_back(std::pow(10.0, bin / kBinsPerDecade));
    }
  }
  return edges;
}

std::vector<double> count_in_bins(const std::vector<double>& values,
                                  const std::vector<double>& edges) {
  std::vector<double> counts(edges.size() - 1);
  for (const double value : values) {
    const auto after = std::upper_bound(edges.begin(), edges.end(), value);
    if (after != edges.begin() && after != edges.end()) ++counts[after - edges.begin() - 1];
  }
  return counts;
}

}  // namespace

std::string draw(const LinePlot& plot) {
  std::string svg = open_svg(plot.y_label + " over " + plot.x_label);
  const double x_high = plot.x.size() > 1 ? plot.x.back() : plot.x.empty() ? 1 : plot.x[0] + 1;
  const Axis x_axis{plot.x.empty() ? 0 : plot.x.front(), x_high, kLeft, kLeft + kPlotWidth,
                    plot.log_x};
  const Axis y_axis = value_axis(plot);

  for (const double x : x_axis.ticks(10)) {
    append_line(svg, "grid", x_axis(x), kTop, x_axis(x), kTop + kPlotHeight);
    append_text(svg, x_axis(x), kTop + kPlotHeight + 16, "middle", short_number(x));
  }
  append_text(svg, kLeft + kPlotWidth / 2, kHeight - 6, "middle", plot.x_label);
  for (const double y : y_axis.ticks(5)) {
    append_line(svg, "grid", kLeft, y_axis(y), kLeft + kPlotWidth, y_axis(y));
    append_text(svg, kLeft - 7, y_axis(y) + 4, "end", short_number(y));
  }
  append_side_label(svg, 14, plot.y_label);
  if (plot.right_factor > 0) {
    Axis right = y_axis;
    right.low *= plot.right_factor;
    right.high *= plot.right_factor;
    for (const double y : right.ticks(5)) {
      append_line(svg, "axis", kLeft + kPlotWidth, right(y), kLeft + kPlotWidth + 4, right(y));
      append_text(svg, kLeft + kPlotWidth + 8, right(y) + 4, "start", short_number(y));
    }
    append_side_label(svg, kWidth - 8, plot.right_label);
  }
  append_frame(svg);
  // One stroke for each column of pixels is enough.
  double last_stroke = -1;
  svg += "<path class='event' d='";
  for (const double event : plot.events) {
    const double x = x_axis(event);
    if (event > x_high || x - last_stroke < 1) continue;
    append(svg, "M%.1f %.1fv6", x, kTop);
    last_stroke = x;
  }
  svg += "'/>";
  if (plot.marked_x >= 0) {
    append_line(svg, "marked", x_axis(plot.marked_x), kTop, x_axis(plot.marked_x),
                kTop + kPlotHeight);
  }
  for (const PlotLine& line : plot.lines) {
    append_curve(svg, line.css_class, plot.x, line.y, x_axis, y_axis);
  }
  if (plot.limit > 0) {
    append_line(svg, "limit", kLeft, y_axis(plot.limit), kLeft + kPlotWidth, y_axis(plot.limit));
    append_text(svg, kLeft + kPlotWidth - 4, y_axis(plot.limit) - 4, "end", plot.limit_label,
                "label halo limit-label");
  }
  append_legend(svg, plot);
  return svg + "</svg>";
}

std::string draw(const Histogram& histogram) {
  std::string svg = open_svg("Histogram: " + histogram.x_label);
  const std::vector<double> edges = bin_edges(histogram);
  const std::vector<double> counts = count_in_bins(histogram.values, edges);
  const double most = *std::max_element(counts.begin(), counts.end());
  const bool log = histogram.bins != Bins::even;
  const Axis x_axis{edges.front(), edges.back(), kLeft, kLeft + kPlotWidth, log};
  // Half a count is the bottom line, so that a single value has a bar.
  const double bottom = kTop + kPlotHeight;
  const Axis y_axis = log ? Axis{0.5, std::max(10.0, most) * 1.5, bottom, kTop, true}
                          : Axis{0, std::max(1.0, most) * 1.06, bottom, kTop, false};
  for (const double y : y_axis.ticks(5)) {
    append_line(svg, "grid", kLeft, y_axis(y), kLeft + kPlotWidth, y_axis(y));
    append_text(svg, kLeft - 7, y_axis(y) + 4, "end", short_number(y));
  }
  append_side_label(svg, 14, histogram.y_label);
  for (const double x : x_axis.ticks(10)) {
    append_line(svg, "grid", x_axis(x), kTop, x_axis(x), bottom);
    append_text(svg, x_axis(x), bottom + 16, "middle", short_number(x));
  }
  append_text(svg, kLeft + kPlotWidth / 2, kHeight - 6, "middle", histogram.x_label);
  for (std::size_t b = 0; b < counts.size(); ++b) {
    if (counts[b] == 0) continue;
    const double left = x_axis(edges[b]), right = x_axis(edges[b + 1]), top = y_axis(counts[b]);
    append(svg, "<rect class='bar' x='%.1f' y='%.1f' width='%.1f' height='%.1f'/>", left, top,
           std::max(right - left - 0.6, 0.8), bottom - top);
  }
  append_frame(svg);
  // Labels step down so that near ones stay readable.
  double y = kTop + 13;
  for (const Marker& marker : histogram.markers) {
    if (!(marker.value > 0)) continue;
    const double x = x_axis(marker.value);
    const bool to_the_left = x > kLeft + 0.75 * kPlotWidth;
    append_line(svg, "limit", x, kTop, x, kTop + kPlotHeight);
    append_text(svg, x + (to_the_left ? -5 : 5), y, to_the_left ? "end" : "start", marker.label,
                "label halo");
    y += 15;
  }
  return svg + "</svg>";
}

}  // namespace palpate
