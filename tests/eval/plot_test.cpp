// Plots: a curve's points land where the axes say.
#include <cmath>
#include <map>
#include <regex>
#include <string>
#include <vector>

#include <gtest/gtest.h>

#include "eval/report/plot_svg.h"

namespace palpate::eval {
namespace {

struct Point {
  double x, y;
};

/// The points of the n-th curve's path.
std::vector<Point> points_of(const std::string& svg, int n) {
  const std::regex path("<path class='curve [^']*' d='([^']*)'"), pair("([-0-9.]+) ([-0-9.]+)");
  auto found = std::sregex_iterator(svg.begin(), svg.end(), path);
  std::advance(found, n);
  const std::string d = (*found)[1];
  std::vector<Point> points;
  for (auto p = std::sregex_iterator(d.begin(), d.end(), pair); p != std::sregex_iterator(); ++p) {
    points.push_back({std::stod((*p)[1]), std::stod((*p)[2])});
  }
  return points;
}

/// Where the ticks of an axis stand: below the plot for x, beside it for y. Keyed by their text.
std::map<std::string, double> ticks_of(const std::string& svg, bool of_x) {
  const std::string anchor = of_x ? "middle" : "end";
  const std::regex tick("<text class='label' x='([-0-9.]+)' y='([-0-9.]+)' text-anchor='" + anchor +
                        "'>([^<]*)</text>");
  std::map<std::string, double> ticks;
  for (auto t = std::sregex_iterator(svg.begin(), svg.end(), tick); t != std::sregex_iterator();
       ++t) {
    // The words of a y tick stand 4 below its line.
    ticks[(*t)[3]] = of_x ? std::stod((*t)[1]) : std::stod((*t)[2]) - 4;
  }
  return ticks;
}

/// The pixel of a value, from two ticks.
double pixel(const std::map<std::string, double>& ticks, const std::string& a, const std::string& b,
             double share) {
  return ticks.at(a) + share * (ticks.at(b) - ticks.at(a));
}

Plot linear_plot() {
  Plot plot;
  plot.x_label = "depth, mm";
  plot.y_label = "force, N";
  plot.curves = {{"ours", "field", {0, 2.5, 10}, {0, 1, 4}}};
  return plot;
}

TEST(Plot, PointsLandWhereTheAxesSay) {
  const std::string svg = draw(linear_plot());
  const auto x = ticks_of(svg, true), y = ticks_of(svg, false);
  const std::vector<Point> points = points_of(svg, 0);
  ASSERT_EQ(points.size(), 3u);
  EXPECT_NEAR(points[0].x, x.at("0"), 0.11);
  EXPECT_NEAR(points[1].x, pixel(x, "0", "10", 0.25), 0.11);
  EXPECT_NEAR(points[2].x, x.at("10"), 0.11);
  EXPECT_NEAR(points[1].y, pixel(y, "0", "4", 0.25), 0.11);
  EXPECT_NEAR(points[2].y, y.at("4"), 0.11);
  EXPECT_LT(y.at("4"), y.at("0"));  // upwards
}

TEST(Plot, LogarithmicAxes) {
  Plot plot = linear_plot();
  plot.curves[0].x = {10, 100, 1000};
  plot.curves[0].y = {0.01, 0.1, 100};
  plot.log_x = plot.log_y = true;
  const std::string svg = draw(plot);
  const auto x = ticks_of(svg, true), y = ticks_of(svg, false);
  const std::vector<Point> points = points_of(svg, 0);
  ASSERT_EQ(points.size(), 3u);
  EXPECT_NEAR(points[1].x, pixel(x, "10", "1000", 0.5), 0.11);
  EXPECT_NEAR(points[1].y, pixel(y, "0.01", "100", 0.25), 0.11);
}

TEST(Plot, EveryCurveHasItsOwnX) {
  Plot plot = linear_plot();
  plot.curves.push_back({"exact", "exact", {5, 10}, {2, 4}});
  const std::string svg = draw(plot);
  const std::vector<Point> first = points_of(svg, 0), second = points_of(svg, 1);
  ASSERT_EQ(second.size(), 2u);
  EXPECT_NEAR(second[1].x, first[2].x, 0.11);
  EXPECT_NEAR(second[1].y, first[2].y, 0.11);
  EXPECT_NEAR(second[0].x, (first[0].x + first[2].x) / 2, 0.11);
}

TEST(Plot, GapsAndOddDataAreDrawn) {
  const double nan = std::nan("");
  Plot plot = linear_plot();
  plot.curves[0].x = {0, 1, 2, 3, 4};
  plot.curves[0].y = {1, 2, nan, 2, INFINITY};
  std::string svg = draw(plot);
  EXPECT_EQ(points_of(svg, 0).size(), 3u);
  EXPECT_EQ(svg.find("nan"), std::string::npos);
  EXPECT_EQ(svg.find("inf"), std::string::npos);
  for (const bool log : {false, true}) {
    plot.log_x = plot.log_y = log;
    for (const std::vector<double>& values :
         {std::vector<double>{}, {0.0}, {nan}, {5, 5}, {-1, -2}, {1e100, 1e-100}}) {
      plot.curves[0].x = plot.curves[0].y = values;
      svg = draw(plot);
      EXPECT_EQ(svg.find("nan"), std::string::npos) << values.size();
    }
  }
  plot.curves.clear();
  EXPECT_NE(draw(plot).find("</svg>"), std::string::npos);
}

TEST(Plot, NamesStandApart) {
  Plot plot = linear_plot();
  plot.curves.clear();
  for (int i = 0; i < 8; ++i) {
    plot.curves.push_back({"curve " + std::to_string(i), "other1", {0, 1}, {0, 1 + 1e-3 * i}});
  }
  const std::string svg = draw(plot);
  const std::regex name("<text class='name [^']*' x='[0-9.]+' y='([0-9.]+)'");
  double before = -100;
  int num = 0;
  for (auto n = std::sregex_iterator(svg.begin(), svg.end(), name); n != std::sregex_iterator();
       ++n, ++num) {
    EXPECT_GE(std::stod((*n)[1]) - before, 14.8);
    before = std::stod((*n)[1]);
  }
  EXPECT_EQ(num, 8);
}

TEST(Plot, WordsAreText) {
  Plot plot = linear_plot();
  plot.x_label = "a < b & \"c\"";
  plot.curves[0].label = "</svg><script>";
  plot.curves[0].style = "'><script>";
  const std::string svg = draw(plot);
  EXPECT_EQ(svg.find("<script"), std::string::npos);
  EXPECT_NE(svg.find("a &lt; b &amp; &quot;c&quot;"), std::string::npos);
}

}  // namespace
}  // namespace palpate::eval
