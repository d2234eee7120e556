#include <gtest/gtest.h>
#include <zlib.h>

#include <algorithm>
#include <cmath>
#include <filesystem>

#include "palpate/session/run.h"
#include "src/io/internal/atomic_file.h"
#include "src/io/internal/base64.h"
#include "src/session/internal/compact_json.h"
#include "src/session/internal/packing_report.h"
#include "src/session/recording/change_list.h"
#include "src/session/report/run_series.h"
#include "tests/session/other_unit_stream.h"
#include "tests/session/path_run.h"
#include "tests/session/synthetic_stream.h"
#include "tests/session/wrench_csv.h"
#include "tests/test_util/report_data.h"

namespace palpate {
namespace {

namespace fs = std::filesystem;
using test::SyntheticStream;

const fs::path kName = "run";

Result<RunOutcome> record(const fs::path& folder, test::PathFunction X_WT, double duration,
                          const RunSettings& settings, int num_frames = 5) {
  SyntheticStream stream(num_frames);
  auto device = test::path_device(std::move(X_WT), 1000, duration);
  return record_run(test::small_tool(), stream, **device, settings, folder / kName);
}

/// With so many significant digits it is as good as the same.
void expect_close(double shown, double written, const std::string& what) {
  EXPECT_LE(std::abs(shown - written), 1e-4 * std::abs(written)) << what;
}

TEST(Report, HasTheNumbersOfTheFilesBesideIt) {
  PALPATE_PAGES_OR_SKIP();
  for (const CouplingKind kind : {CouplingKind::none, CouplingKind::virtual_coupling}) {
    RunSettings settings = test::path_settings();
    settings.coupling.kind = kind;
    settings.contact.method = MethodKind::graph;
    settings.time.mode = TimeMode::latest;
    const test::TemporaryFolder folder;
    const auto outcome = record(folder.path(), test::pressing_pose, 10, settings);
    ASSERT_TRUE(outcome) << outcome.error().message;
    const fs::path run = folder.path() / kName;
    const auto page = test::report_data_of(run / "report.html");
    EXPECT_EQ(page.at("kind"), "run");
    const auto summary = nlohmann::json::parse(read_file(run / "summary.json").value());
    EXPECT_EQ(page.at("summary"), summary);

    // Every row of the course is one of wrench.csv, and all of a short run are there.
    auto columns = test::columns_of(run / "wrench.csv");
    const auto& series = page.at("series");
    const std::size_t num = columns.at("time_s").size();
    ASSERT_EQ(series.at("time_s").size(), num);
    int num_columns = 0;
    for (const auto& [name, values] : series.items()) {
      ASSERT_EQ(values.size(), num) << name;
      if (columns.count(name) == 0) continue;
      ++num_columns;
      for (std::size_t k = 0; k < num; ++k) {
        expect_close(values[k].get<double>(), columns[name][k], name + std::to_string(k));
      }
    }
    EXPECT_EQ(num_columns, kind == CouplingKind::none ? 15 : 26);

    // The deepest moment: the spheres of the tool, in the states that were counted then.
    const auto& moment = page.at("moment");
    const auto deepest = std::max_element(columns["volume_m3"].begin(), columns["volume_m3"].end());
    const auto k = static_cast<std::size_t>(deepest - columns["volume_m3"].begin());
    expect_close(moment.at("volume_m3"), *deepest, "volume");
    EXPECT_EQ(moment.at("time_s"), columns["time_s"][k]);
    expect_close(moment.at("force_N").at(2), columns["force_z_N"][k], "force");
    const auto tool = test::small_tool();
    const auto spheres = test::from_packed<float>(moment.at("spheres"));
    ASSERT_EQ(spheres.size(), 4 * tool.spheres().size());
    EXPECT_EQ(spheres[4 * 7 + 1], tool.spheres()[7].center.y);
    EXPECT_EQ(spheres[4 * 7 + 3], tool.spheres()[7].radius);
    int num_of[3] = {}, num_cut = 0;
    for (const std::uint8_t state : test::from_packed<std::uint8_t>(moment.at("states"))) {
      ++num_of[state & 3];
      num_cut += state >> 2;
    }
    EXPECT_GT(num_of[1], 0);
    EXPECT_EQ(num_of[1], columns["boundary_spheres"][k]);
    EXPECT_EQ(num_of[2], columns["inside_spheres"][k]);
    EXPECT_EQ(test::from_packed<float>(moment.at("planes")).size(),
              4 * static_cast<std::size_t>(num_cut));

    // The depth image is the one that was felt then, pixel by pixel.
    SyntheticStream stream(5);
    DepthFrame frame;
    for (int i = 0; i <= columns["frame"][k]; ++i) ASSERT_TRUE(stream.next(frame));
    std::string packed = test::from_base64(moment.at("cameras").at(0).at("depth"));
    const std::size_t num_pixels = frame.pixels.size();
    std::vector<unsigned char> bytes(2 * num_pixels);
    uLongf size = bytes.size();
    ASSERT_EQ(uncompress(bytes.data(), &size, reinterpret_cast<unsigned char*>(packed.data()),
                         packed.size()),
              Z_OK);
    ASSERT_EQ(size, bytes.size());
    EXPECT_EQ(moment.at("cameras").at(0).at("width"), frame.width);
    for (std::size_t i = 0; i < num_pixels; ++i) {
      const int left = i % 96 == 0 ? 0 : frame.pixels[i - 1];
      ASSERT_EQ((left + bytes[i] + 256 * bytes[num_pixels + i]) % 65536, frame.pixels[i]) << i;
    }
  }
}

TEST(Report, ShowsTheDeepestMomentInTheUnitOfItsFrame) {
  PALPATE_PAGES_OR_SKIP();
  const test::TemporaryFolder folder;
  test::OtherUnitStream stream(5, 1);
  auto device = test::path_device([](double) { return test::pressing_pose(0.3); }, 200);
  ASSERT_TRUE(record_run(test::small_tool(), stream, **device, test::path_settings(200),
                         folder.path() / kName));
  const auto page = test::report_data_of(folder.path() / kName / "report.html");
  ASSERT_GT(page.at("moment").at("time_s"), 0.04);  // the wall comes nearer
  EXPECT_EQ(page.at("moment").at("cameras").at(0).at("unit"), SyntheticStream(1).info().unit / 5);
}

TEST(Report, IsWholeEscapedAndAsksNobody) {
  PALPATE_PAGES_OR_SKIP();
  const test::TemporaryFolder folder;
  ASSERT_TRUE(record(folder.path(), test::pressing_pose, 10, test::path_settings()));
  const std::string html = read_file(folder.path() / kName / "report.html").value();
  for (const char* bad : {"<wall>", "http:", "https:", "{{"}) {
    EXPECT_EQ(html.find(bad), std::string::npos) << bad;
  }
  EXPECT_NE(html.find("in synthetic &lt;wall&gt; &amp; \"bumps\"</title>"), std::string::npos);
  EXPECT_EQ(test::report_data(html).at("summary").at("stream").at("name"),
            SyntheticStream(1).info().name);
  EXPECT_EQ(html.substr(html.size() - 8), "</html>\n");
}

TEST(Report, RunWithoutContactAndTinyRunsWork) {
  for (const Vec3d& away : {Vec3d{0, 0, 0.1}, Vec3d{5, 5, -3}, Vec3d{NAN, 0, 0}}) {
    const test::TemporaryFolder folder;
    const auto outcome = record(
        folder.path(),
        [&](double) {
          return Pose{away, {}};
        },
        0.001, test::path_settings(), 1);
    ASSERT_TRUE(outcome) << outcome.error().message;
    EXPECT_EQ(outcome->not_kept, "");
    if (report_template().empty()) continue;
    const auto page = test::report_data_of(folder.path() / kName / "report.html");
    EXPECT_EQ(page.at("moment").at("volume_m3"), 0);
    const double x = test::columns_of(folder.path() / kName / "wrench.csv").at("tool_x_m").at(0);
    const auto& shown = page.at("moment").at("X_WT").at(0);
    EXPECT_TRUE(std::isfinite(x) ? shown == x : shown.is_null()) << shown;
  }
}

TEST(Report, LongRunsStaySmallAndKeepTheirPeaks) {
  RunSeries series;
  for (int i = 0; i < 200000; ++i) {
    TickRecord tick;
    tick.time = i * 1e-3;
    tick.step.contact_W.force.z = i == 123456 ? 1000 : std::sin(i * 0.1);
    series.add(tick);
  }
  EXPECT_LE(series.ticks().size(), 16384u);
  const auto most = std::max_element(series.ticks().begin(), series.ticks().end(),
                                     [](const auto& a, const auto& b) {
                                       return a.step.contact_W.force.z < b.step.contact_W.force.z;
                                     });
  EXPECT_EQ(most->time, 123.456);
}

TEST(Report, NumbersAreAsShortAsAsked) {
  EXPECT_EQ(compact(0.123456789).dump(), "0.12346");
  EXPECT_EQ(compact(-1.23456789e-7, 3).dump(), "-1.23e-07");
  EXPECT_EQ(compact(0).dump(), "0.0");
  EXPECT_TRUE(compact(NAN).is_null());
  EXPECT_TRUE(compact(INFINITY).is_null());
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

// Weeks of changes: the first ones and the last ones, each by what it changed.
TEST(ChangeList, KeepsTheFirstAndTheLast) {
  RunSettings settings;
  ChangeList changes(settings);
  constexpr int kNum = 1000;
  for (int i = 0; i < kNum; ++i) {
    settings.coupling.stiffness = 100 + i;
    if (i == 7) settings.time.mode = TimeMode::predict;
    changes.add(settings);
  }
  changes.add(settings);  // nothing
  EXPECT_EQ(changes.num(), kNum + 1u);
  const auto list = changes.json();
  ASSERT_EQ(list.size(), 2 * ChangeList::kNumKept);
  EXPECT_EQ(list[0].dump(), R"({"coupling":{"stiffness":100.0}})");
  EXPECT_EQ(list[7].dump(), R"({"time":{"mode":"predict"},"coupling":{"stiffness":107.0}})");
  EXPECT_EQ(list[ChangeList::kNumKept - 1]["coupling"]["stiffness"], 299);
  EXPECT_EQ(list[ChangeList::kNumKept]["coupling"]["stiffness"], 901);
  EXPECT_EQ(list[2 * ChangeList::kNumKept - 1].dump(), "{}");
}

}  // namespace
}  // namespace palpate
