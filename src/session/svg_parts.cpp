#include "src/session/svg_parts.h"

#include <algorithm>
#include <cmath>
#include <cstdarg>
#include <cstdio>

namespace palpate {

double Axis::operator()(double value) const {
  const double share =
      log ? std::log(value / low) / std::log(high / low) : (value - low) / (high - low);
  return from + share * (to - from);
}

std::vector<double> Axis::ticks(int about) const {
  std::vector<double> values;
  constexpr double kFewDecades = 2.5;
  if (log) {
    const int first = static_cast<int>(std::floor(std::log10(low) - 1e-9));
    const int last = static_cast<int>(std::ceil(std::log10(high) + 1e-9));
    const int step = std::max(1, (last - first) / about);
    for (int e = first; e <= last; e += step) {
      for (const int lead : {1, 2, 5}) {
        const double value = lead * std::pow(10.0, e);
        if (lead > 1 && std::log10(high / low) > kFewDecades) break;
        if (value >= low * (1 - 1e-9) && value <= high * (1 + 1e-9)) values.push_back(value);
      }
    }
    return values;
  }
  const double rough = (high - low) / about;
  const double power = std::pow(10.0, std::floor(std::log10(rough)));
  const double lead = rough / power;
  const double step = power * (lead < 1.5 ? 1 : lead < 3.5 ? 2 : lead < 7.5 ? 5 : 10);
  const double first = std::ceil(low / step - 1e-9);
  for (double k = first; k * step <= high + 1e-9 * step; ++k) {
    values.push_back(std::abs(k) < 0.5 ? 0.0 : k * step);
  }
  return values;
}

void append(std::string& svg, const char* format, ...) {
  char buffer[512];
  va_list arguments;
  va_start(arguments, format);
  std::vsnprintf(buffer, sizeof buffer, format, arguments);
  va_end(arguments);
  svg += buffer;
}

void append_text(std::string& svg, double x, double y, const char* anchor, const std::string& text,
                 const char* css_class) {
  append(svg, "<text class='%s' x='%.1f' y='%.1f' text-anchor='%s'>", css_class, x, y, anchor);
  svg += escape_html(text) + "</text>";
}

void append_line(std::string& svg, const char* css_class, double x1, double y1, double x2,
                 double y2) {
  append(svg, "<line class='%s' x1='%.1f' y1='%.1f' x2='%.1f' y2='%.1f'/>", css_class, x1, y1, x2,
         y2);
}

void append_curve(std::string& svg, const std::string& css_class, const std::vector<double>& x,
                  const std::vector<double>& y, const Axis& x_axis, const Axis& y_axis) {
  svg += "<path class='curve " + css_class + "' d='";
  bool pen_down = false;
  const auto point = [&](std::size_t i) {
    append(svg, "%c%.1f %.1f", pen_down ? 'L' : 'M', x_axis(x[i]), y_axis(y[i]));
    pen_down = true;
  };
  const auto drawable = [](double value, const Axis& axis) {
    return std::isfinite(value) && (!axis.log || value > 0);
  };
  const auto usable = [&](std::size_t k) {
    return drawable(x[k], x_axis) && drawable(y[k], y_axis);
  };
  const bool decimate = static_cast<double>(x.size()) > 2 * std::abs(x_axis.to - x_axis.from);
  std::size_t i = 0;
  while (i < x.size()) {
    if (!usable(i)) {
      pen_down = false;
      ++i;
      continue;
    }
    std::size_t low = i, high = i, end = i + 1;
    if (decimate) {
      const double column = std::floor(x_axis(x[i]));
      for (; end < x.size() && usable(end) && std::floor(x_axis(x[end])) == column; ++end) {
        if (y[end] < y[low]) low = end;
        if (y[end] > y[high]) high = end;
      }
    }
    point(std::min(low, high));
    if (low != high) point(std::max(low, high));
    i = end;
  }
  svg += "'/>";
}

std::string short_number(double value, int digits) {
  char buffer[40];
  // Large whole numbers in full: 12000, not 1.2e+04.
  const bool large = std::abs(value) >= std::pow(10.0, digits) && std::abs(value) < 1e7;
  std::snprintf(buffer, sizeof buffer, large ? "%.*f" : "%.*g", large ? 0 : digits, value);
  return buffer;
}

std::string escape_html(const std::string& text) {
  std::string escaped;
  for (const char c : text) {
    switch (c) {
      case '&': escaped += "&amp;"; break;
      case '<': escaped += "&lt;"; break;
      case '>': escaped += "&gt;"; break;
      case '\'': escaped += "&#39;"; break;
      case '"': escaped += "&quot;"; break;
      default: escaped += c;
    }
  }
  return escaped;
}

}  // namespace palpate
