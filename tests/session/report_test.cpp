#include "palpate/session/report.h"

#include <gtest/gtest.h>

#include <cmath>

#include "src/session/base64.h"
#include "src/session/scene_picture.h"
#include "src/session/statistics.h"
#include "src/session/svg_plot.h"
#include "tests/session/synthetic_stream.h"

namespace palpate {
namespace {

std::size_t count(const std::string& text, const std::string& word) {
  std::size_t n = 0;
  for (std::size_t at = text.find(word); at != std::string::npos; at = text.find(word, at + 1)) ++n;
  return n;
}

TEST(Report, IsWholeAndEscaped) {
  const Tool tool = test::small_tool();
  test::SyntheticStream stream(5);
  const auto log = run_session(
      tool, stream, [](std::size_t, double time) { return test::pressing_pose(time); }, {});
  ASSERT_TRUE(log) << log.error().message;
  const auto html = make_report(tool, *log);
  ASSERT_TRUE(html) << html.error().message;
  EXPECT_EQ(count(*html, "data:image/png;base64,iVBOR"), 3u);
  EXPECT_EQ(count(*html, "<svg"), count(*html, "</svg>"));
  EXPECT_GE(count(*html, "<svg"), 8u);
  EXPECT_EQ(count(*html, "<wall>"), 0u);
  EXPECT_GE(count(*html, "&lt;wall&gt;"), 1u);
  EXPECT_EQ(count(*html, "nan"), 0u);
  EXPECT_EQ(count(*html, "http"), 0u) << "the page must not need the network";
}

TEST(Report, RunWithoutContactAndTinyRunsWork) {
  const Tool tool = test::small_tool();
  for (const Vec3d& away : {Vec3d{0, 0, 0.1}, Vec3d{5, 5, -3}, Vec3d{NAN, 0, 0}}) {
    test::SyntheticStream stream(1);
    RunSettings settings;
    settings.duration = 0.001;
    const auto log = run_session(
        tool, stream,
        [&](std::size_t, double) {
          return Pose{away, {}};
        },
        settings);
    ASSERT_TRUE(log) << log.error().message;
    EXPECT_EQ(log->ticks.size(), 1u);
    EXPECT_TRUE(make_report(tool, *log));
  }
}

TEST(SvgPlot, LongRunsStaySmallAndKeepTheirPeaks) {
  LinePlot plot;
  plot.y_label = "y";
  plot.lines.push_back({"line", "series1", {}});
  for (int i = 0; i < 200000; ++i) {
    plot.x.push_back(i * 1e-3);
    plot.lines[0].y.push_back(i == 123456 ? 1000 : std::sin(i * 0.1));
  }
  const std::string svg = draw(plot);
  EXPECT_LT(svg.size(), 60000u);
  // The peak is at 1000 / 1060 of the height: y axis from 0 (or lower) with a margin.
  EXPECT_NE(svg.find("1000"), std::string::npos);
  EXPECT_EQ(svg.find("nan"), std::string::npos);
}

TEST(Statistics, NearestRank) {
  std::vector<double> values;
  for (int i = 1000; i >= 1; --i) values.push_back(i);
  const Percentiles p = percentiles(values);
  EXPECT_EQ(p.median, 500);
  EXPECT_EQ(p.p99, 990);
  EXPECT_EQ(p.p999, 999);
  EXPECT_EQ(p.max, 1000);
  EXPECT_EQ(percentiles({3.0}).median, 3);
  EXPECT_EQ(percentiles({}).max, 0);
}

TEST(Base64, KnownAnswers) {
  EXPECT_EQ(base64(""), "");
  EXPECT_EQ(base64("f"), "Zg==");
  EXPECT_EQ(base64("fo"), "Zm8=");
  EXPECT_EQ(base64("foo"), "Zm9v");
  EXPECT_EQ(base64("foobar"), "Zm9vYmFy");
  EXPECT_EQ(base64("\xff\xfe"), "//4=");
}

}  // namespace
}  // namespace palpate
