// Shared parts of the speed figures.
#pragma once

#include <string>
#include <vector>

#include "eval/figure.h"
#include "eval/studies/interaction.h"

namespace palpate::eval {

/// Times of every method over a varying x.
struct SpeedSweep {
  std::vector<double> x;
  std::vector<Method> methods;
  std::vector<std::vector<Times>> times;  ///< [method][x]

  /// Microseconds.
  std::vector<double> medians(std::size_t method) const;
  std::vector<double> means(std::size_t method) const;
  std::size_t method(const std::string& name) const;
};

/// Plots medians in microseconds, with the line of 1 kHz.
Plot speed_plot(const SpeedSweep& sweep, const std::string& title, const std::string& x_label);
/// Makes a table of the same medians, a row for each x (a number of spheres).
Table time_table(const SpeedSweep& sweep, const std::string& title);
/// Formats a time (µs) with at least two digits.
std::string time_words(double microseconds);
/// Adds median, p99 and largest of every method at every x, as numbers `prefix.method.x.median_us`.
void add_numbers(FigureResult& result, const SpeedSweep& sweep, const std::string& prefix);

/// Describes the measured x at which curve a lies clearly below curve b, e.g. "at no size up to
/// 17000", "up to 500 spheres", "from 8000 spheres on", "at 3 of 7 sizes".
std::string where_below(const std::vector<double>& x, const std::vector<double>& a,
                        const std::vector<double>& b, const char* what = "size",
                        const char* unit = "spheres");
/// Returns the largest x up to which y stays below `limit` (linear in between); the last x if it
/// always does.
double reaches(const std::vector<double>& x, const std::vector<double>& y, double limit);

std::vector<FigureSpec> subtask_figures();  // 5.5
std::vector<FigureSpec> synthetic_speed();  // 3.10, 5.6, more spheres and pixels than in the thesis
std::vector<FigureSpec> option_speed();     // cost of edges and continuity: options
std::vector<FigureSpec> sensing_speed();    // cost of a depth frame: sensing
std::vector<FigureSpec> gpu_figures();      // 4.2, 4.3, queries on a GPU

/// printf for sentences.
[[gnu::format(printf, 1, 2)]] std::string words(const char* format, ...);

}  // namespace palpate::eval
