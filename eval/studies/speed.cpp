#include "eval/studies/speed.h"

#include <algorithm>
#include <cmath>
#include <cstdarg>
#include <cstdio>

#include "eval/studies/verdict_rules.h"

namespace palpate::eval {

std::vector<double> SpeedSweep::medians(std::size_t method) const {
  std::vector<double> medians;
  for (const Times& t : times[method]) medians.push_back(1e6 * t.median);
  return medians;
}

std::vector<double> SpeedSweep::means(std::size_t method) const {
  std::vector<double> means;
  for (const Times& t : times[method]) means.push_back(1e6 * t.mean);
  return means;
}

std::size_t SpeedSweep::method(const std::string& name) const {
  for (std::size_t i = 0; i < methods.size(); ++i) {
    if (methods[i].name == name) return i;
  }
  return 0;
}

Plot speed_plot(const SpeedSweep& sweep, const std::string& title, const std::string& x_label) {
  Plot plot;
  plot.title = title;
  plot.x_label = x_label;
  plot.y_label = "time of one query, µs (median)";
  for (std::size_t m = 0; m < sweep.methods.size(); ++m) {
    plot.curves.push_back(
        {sweep.methods[m].name, sweep.methods[m].name, sweep.x, sweep.medians(m)});
  }
  return plot;
}

std::string time_words(double microseconds) {
  return words(microseconds < 10 ? "%.1f" : "%.0f", microseconds);
}

Table time_table(const SpeedSweep& sweep, const std::string& title) {
  Table table{title, {"spheres"}, {}};
  for (const Method& method : sweep.methods) table.columns.emplace_back(method.name);
  for (std::size_t i = 0; i < sweep.x.size(); ++i) {
    std::vector<std::string> row{words("%.0f", sweep.x[i])};
    for (std::size_t m = 0; m < sweep.methods.size(); ++m) {
      row.push_back(time_words(1e6 * sweep.times[m][i].median));
    }
    table.rows.push_back(std::move(row));
  }
  return table;
}

void add_numbers(FigureResult& result, const SpeedSweep& sweep, const std::string& prefix) {
  for (std::size_t m = 0; m < sweep.methods.size(); ++m) {
    for (std::size_t i = 0; i < sweep.x.size(); ++i) {
      const Times& t = sweep.times[m][i];
      const std::string key = words("%s.%s.%g.", prefix.c_str(), sweep.methods[m].name, sweep.x[i]);
      result.numbers.push_back({key + "median", 1e6 * t.median, "µs"});
      result.numbers.push_back({key + "p99", 1e6 * t.p99, "µs"});
      result.numbers.push_back({key + "max", 1e6 * t.max, "µs"});
    }
  }
}

std::string where_below(const std::vector<double>& x, const std::vector<double>& a,
                        const std::vector<double>& b, const char* what, const char* unit) {
  std::vector<double> below;
  for (std::size_t i = 0; i < x.size(); ++i) {
    if (is_clearly_less(a[i], b[i])) below.push_back(x[i]);
  }
  if (below.empty()) return words("at no %s up to %.0f %s", what, x.back(), unit);
  if (below.size() == x.size()) {
    return words("at every %s from %.0f to %.0f %s", what, x.front(), x.back(), unit);
  }
  if (std::equal(below.begin(), below.end(), x.begin())) {
    return words("up to %.0f %s", below.back(), unit);
  }
  if (std::equal(below.rbegin(), below.rend(), x.rbegin())) {
    return words("from %.0f %s on", below[0], unit);
  }
  return words("at %zu of %zu %ss", below.size(), x.size(), what);
}

double reaches(const std::vector<double>& x, const std::vector<double>& y, double limit) {
  if (y.empty() || y[0] > limit) return 0;
  for (std::size_t i = 0; i + 1 < x.size(); ++i) {
    if (y[i + 1] > limit) return x[i] + (x[i + 1] - x[i]) * (limit - y[i]) / (y[i + 1] - y[i]);
  }
  return x.back();
}

std::string words(const char* format, ...) {
  va_list arguments;
  va_start(arguments, format);
  char text[1024];
  std::vsnprintf(text, sizeof text, format, arguments);
  va_end(arguments);
  return text;
}

}  // namespace palpate::eval
