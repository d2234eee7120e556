#include <gtest/gtest.h>

#include <cmath>

#include "palpate/io/atomic_file.h"
#include "palpate/session/run.h"
#include "src/session/base64.h"
#include "src/session/scene_picture.h"
#include "src/session/statistics.h"
#include "src/session/svg_plot.h"
#include "tests/session/path_run.h"
#include "tests/session/synthetic_stream.h"

namespace palpate {
namespace {

std::size_t count(const std::string& text, const std::string& word) {
  std::size_t n = 0;
  for (std::size_t at = text.find(word); at != std::string::npos; at = text.find(word, at + 1)) ++n;
  return n;
}

Result<std::string> report_of(test::SyntheticStream stream, test::PathFunction X_WT,
                              double duration, const RunSettings& settings) {
  const test::TemporaryFolder folder;
  auto device = test::path_device(std::move(X_WT), 1000, duration);
  const auto outcome =
      record_run(test::small_tool(), stream, **device, settings, folder.path() / "run");
  if (!outcome) return outcome.error();
  return read_file(folder.path() / "run" / "report.html");
}

TEST(Report, IsWholeAndEscaped) {
  for (const CouplingKind kind : {CouplingKind::none, CouplingKind::virtual_coupling}) {
    RunSettings settings = test::path_settings();
    settings.coupling.kind = kind;
    const auto html = report_of(test::SyntheticStream(5), test::pressing_pose, 10, settings);
    ASSERT_TRUE(html) << html.error().message;
    EXPECT_EQ(count(*html, "data:image/png;base64,iVBOR"), 3u);
    EXPECT_EQ(count(*html, "<svg"), count(*html, "</svg>"));
    EXPECT_GE(count(*html, "<svg"), 7u);
    EXPECT_EQ(count(*html, "<wall>"), 0u);
    EXPECT_GE(count(*html, "&lt;wall&gt;"), 1u);
    EXPECT_EQ(count(*html, "nan"), 0u);
    EXPECT_EQ(count(*html, "http"), 0u) << "the page must not need the network";
    EXPECT_EQ(count(*html, "What the hand felt"), kind == CouplingKind::none ? 0u : 1u);
  }
}

TEST(Report, RunWithoutContactAndTinyRunsWork) {
  for (const Vec3d& away : {Vec3d{0, 0, 0.1}, Vec3d{5, 5, -3}, Vec3d{NAN, 0, 0}}) {
    const auto html = report_of(
        test::SyntheticStream(1),
        [&](double) {
          return Pose{away, {}};
        },
        0.001, test::path_settings());
    EXPECT_TRUE(html) << html.error().message;
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
  for (int i = 1; i <= 1000; ++i) values.push_back(i);
  EXPECT_EQ(nearest_rank(values, 0.5), 500);
  EXPECT_EQ(nearest_rank(values, 0.999), 999);
  EXPECT_EQ(nearest_rank(values, 1), 1000);
  EXPECT_EQ(nearest_rank(std::vector{3.0}, 0.5), 3);
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
