// Running and reporting figures, with figures made up for it.
#include <algorithm>
#include <cmath>
#include <filesystem>
#include <fstream>
#include <sstream>
#include <stdexcept>
#include <string>

#include <gtest/gtest.h>

#include "eval/report/choose.h"
#include "eval/report/report.h"
#include "eval/report/run_evaluation.h"
#include "eval/studies/speed.h"
#include "tests/test_util/data.h"
#include "tests/test_util/report_data.h"
#include "tests/test_util/temporary_folder.h"

namespace palpate::eval {
namespace {

namespace fs = std::filesystem;

int g_num_made = 0;

FigureResult some_result() {
  FigureResult result;
  result.claims = {{"1.7 times faster & <simpler>", "1.5 times | slower", Verdict::contradicts},
                   {"smooth", "smooth", Verdict::better},
                   {"fast", "no GPU", Verdict::not_measured, Source::docs}};
  result.pictures = {
      {Picture::Kind::cut_open, "A <tool>", R"({"spheres":"aGVsbG8="})", "seen from the side"}};
  result.plots = {{"Force",
                   "depth, mm",
                   "force, N",
                   {{"field", "field", {0, 1, 2}, {0.1, std::nan(""), 1.0 / 3}}},
                   true,
                   false,
                   "It rises."}};
  result.tables = {
      {"Times", {"spheres", "time, µs"}, {{"1000", "1.5"}, {"a \"quote\", comma", "2"}}}};
  result.numbers = {{"ratio", 1.0 / 3, ""}, {"none", std::nan(""), "ms"}};
  result.notes = {"made <up>"};
  return result;
}

Result<FigureResult> make_good(Context& context) {
  context.progress(0.5);
  ++g_num_made;
  return some_result();
}
Result<FigureResult> make_failing(Context&) { return Error{Errc::bad_input, "there is no <tool>"}; }
Result<FigureResult> make_throwing(Context&) { throw std::runtime_error("out of spheres"); }
Result<FigureResult> make_elsewhere(Context&) {
  FigureResult result;
  result.claims = {{"fast", "1 ms", Verdict::better}};
  result.rows_of = "another machine, commit abc";
  return result;
}
Result<FigureResult> make_drawing(Context&) {
  FigureResult result;
  result.tables = some_result().tables;
  return result;
}
Result<FigureResult> make_silent(Context&) { return FigureResult(); }

const FigureSpec kGood{"5.1-5.3", "Times & sizes", "Speed", make_good};
const FigureSpec kNoise{"noise", "Noise", "Robustness", make_good};
const FigureSpec kFailing{"5.9", "Failing", "Quality", make_failing};
const FigureSpec kThrowing{"5.10", "Throwing", "Quality", make_throwing};
const FigureSpec kElsewhere{"rows", "Rows", "Speed", make_elsewhere};
const FigureSpec kSilent{"5.11", "Silent", "Quality", make_silent};

std::string text_of(const fs::path& path) {
  std::ostringstream text;
  text << std::ifstream(path).rdbuf();
  return text.str();
}

class Run : public testing::Test {
 protected:
  void SetUp() override {
    g_num_made = 0;
    options_.output = folder_;
  }

  Evaluation run(const std::vector<FigureSpec>& figures) {
    auto evaluation = run_evaluation(figures, figures, options_, watcher_);
    EXPECT_TRUE(evaluation) << evaluation.error().message;
    return *evaluation;
  }

  const test::TemporaryFolder temporary_;
  const fs::path folder_ = temporary_ / "report";
  EvaluationOptions options_;
  Watcher watcher_;
};

TEST_F(Run, StoredFiguresReadBackTheSame) {
  StoredFigure figure{"5.1", key_of({}), "abc", "2026-11-21 23:00", 1.25, "", some_result()};
  ASSERT_TRUE(save_figure(figure, folder_));
  const auto read = load_figure("5.1", folder_);
  ASSERT_TRUE(read) << read.error().message;
  EXPECT_EQ(read->key, figure.key);
  EXPECT_EQ(read->commit, "abc");
  EXPECT_EQ(read->seconds, 1.25);
  const FigureResult& a = figure.result;
  const FigureResult& b = read->result;
  ASSERT_EQ(b.claims.size(), 3u);
  EXPECT_EQ(b.claims[0].claim, a.claims[0].claim);
  EXPECT_EQ(b.claims[0].verdict, Verdict::contradicts);
  EXPECT_EQ(b.claims[1].source, Source::ours);
  EXPECT_EQ(b.claims[2].source, Source::docs);
  EXPECT_EQ(b.pictures[0].kind, Picture::Kind::cut_open);
  EXPECT_EQ(b.pictures[0].data, R"({"spheres":"aGVsbG8="})");
  ASSERT_EQ(b.plots.size(), 1u);
  EXPECT_EQ(b.plots[0].curves[0].x, a.plots[0].curves[0].x);
  EXPECT_EQ(b.plots[0].curves[0].y[2], 1.0 / 3);
  EXPECT_TRUE(std::isnan(b.plots[0].curves[0].y[1]));
  EXPECT_TRUE(b.plots[0].log_x);
  EXPECT_EQ(b.plots[0].caption, "It rises.");
  EXPECT_EQ(b.tables[0].rows, a.tables[0].rows);
  EXPECT_EQ(b.numbers[0].value, 1.0 / 3);
  EXPECT_TRUE(std::isnan(b.numbers[1].value));
  EXPECT_EQ(b.notes, a.notes);
}

TEST_F(Run, CsvFilesForOtherPrograms) {
  StoredFigure figure{"a/b", {}, "", "", 0, "", some_result()};
  ASSERT_TRUE(save_figure(figure, folder_));
  EXPECT_EQ(text_of(folder_ / "a_b-plot1.csv"),
            "curve,\"depth, mm\",\"force, N\"\n\"field\",0.0,0.1\n\"field\",1.0,\n"
            "\"field\",2.0,0.3333333333333333\n");
  EXPECT_EQ(text_of(folder_ / "a_b-table1.csv"),
            "\"spheres\",\"time, µs\"\n\"1000\",\"1.5\"\n\"a \"\"quote\"\", comma\",\"2\"\n");
  EXPECT_TRUE(fs::exists(folder_ / "a_b-numbers.csv"));
  figure.result.plots.clear();
  ASSERT_TRUE(save_figure(figure, folder_));
  EXPECT_FALSE(fs::exists(folder_ / "a_b-plot1.csv"));
}

TEST_F(Run, AFileCutOffAnywhereIsNoFigure) {
  ASSERT_TRUE(save_figure({"5.1", {}, "", "", 0, "", some_result()}, folder_));
  const std::string whole = text_of(folder_ / "5.1.json");
  for (std::size_t size = 0; size + 2 < whole.size(); size += 7) {
    std::ofstream(folder_ / "5.1.json", std::ios::binary) << whole.substr(0, size);
    const auto read = load_figure("5.1", folder_);
    ASSERT_FALSE(read) << size;
    EXPECT_EQ(read.error().code, Errc::bad_input);
  }
  for (const char* other : {"null", "[]", "{\"format\":\"palpate figure 1\",\"id\":\"5.1\"}"}) {
    std::ofstream(folder_ / "5.1.json") << other;
    EXPECT_FALSE(load_figure("5.1", folder_)) << other;
  }
}

TEST_F(Run, KeepsWhatWouldComeOutTheSame) {
  EXPECT_EQ(run({kGood, kNoise}).num_made, 2);
  Evaluation again = run({kGood, kNoise});
  EXPECT_EQ(again.num_made, 0);
  EXPECT_EQ(again.num_kept, 2);
  EXPECT_EQ(g_num_made, 2);

  options_.fresh = true;
  EXPECT_EQ(run({kGood}).num_made, 1);
  options_.fresh = false;

  // The full form serves the quick one, but not the other way round.
  options_.settings.quick = true;
  EXPECT_EQ(run({kGood}).num_kept, 1);
  options_.fresh = true;
  EXPECT_EQ(run({kGood}).num_made, 1);
  options_.fresh = false;
  options_.settings.quick = false;
  EXPECT_EQ(run({kGood}).num_made, 1);

  // Other data: made again. A broken file: made again, with a warning.
  options_.settings.data = folder_;
  EXPECT_EQ(run({kGood}).num_made, 1);
  std::ofstream(folder_ / kDataFolder / "5.1-5.3.json") << "{";
  const Evaluation fixed = run({kGood});
  EXPECT_EQ(fixed.num_made, 1);
  EXPECT_EQ(fixed.warnings.size(), 1u);
}

TEST_F(Run, AFigureThatFailsDoesNotStopTheOthers) {
  const Evaluation evaluation = run({kFailing, kThrowing, kSilent, kGood});
  EXPECT_EQ(evaluation.num_failed, 3);
  EXPECT_EQ(evaluation.num_made, 1);
  if (!report_template().empty()) {
    const auto figures = test::report_data_of(folder_ / kReportPage).at("figures");
    EXPECT_EQ(figures[0].at("stored").at("failure"), "there is no <tool>");
    EXPECT_EQ(figures[1].at("stored").at("failure"), "out of spheres");
  }
  // Failures are tried again, what is done is not.
  const Evaluation again = run({kFailing, kGood});
  EXPECT_EQ(again.num_failed, 1);
  EXPECT_EQ(again.num_kept, 1);
}

TEST_F(Run, AnInterruptKeepsWhatIsDone) {
  watcher_.keep_going = [] { return g_num_made < 1; };
  const Evaluation stopped = run({kGood, kNoise});
  EXPECT_TRUE(stopped.interrupted);
  EXPECT_EQ(stopped.num_made, 1);
  EXPECT_EQ(fs::exists(folder_ / kReportPage), !report_template().empty());
  watcher_.keep_going = {};
  const Evaluation resumed = run({kGood, kNoise});
  EXPECT_FALSE(resumed.interrupted);
  EXPECT_EQ(resumed.num_kept, 1);
  EXPECT_EQ(resumed.num_made, 1);
}

TEST_F(Run, LeavesOtherFoldersAlone) {
  fs::create_directories(folder_);
  std::ofstream(folder_ / "thesis.doc") << "mine";
  const std::vector<FigureSpec> figures{kGood};
  const auto refused = run_evaluation(figures, figures, options_, watcher_);
  ASSERT_FALSE(refused);
  EXPECT_NE(refused.error().message.find("thesis.doc"), std::string::npos);
  EXPECT_FALSE(fs::exists(folder_ / kDataFolder));
  options_.output = folder_ / "thesis.doc";
  EXPECT_FALSE(run_evaluation(figures, figures, options_, watcher_));
}

TEST_F(Run, TheReportHasEveryClaim) {
  options_.command = "palpate eval -o <here>";
  const Evaluation evaluation = run({kGood, kNoise, kFailing});
  if (!report_template().empty()) {
    const std::string page = text_of(folder_ / kReportPage);
    for (const char* refused : {"<up>", "<simpler>", "<here>"}) {
      EXPECT_EQ(page.find(refused), std::string::npos) << refused;
    }
    const auto data = test::report_data(page);
    EXPECT_EQ(data.at("kind"), "evaluation");
    EXPECT_EQ(data.at("command"), "palpate eval -o <here>");
    EXPECT_EQ(data.at("sources")[0].at("counts")[0], nlohmann::json({"contradicts", 2}));
    const auto& figure = data.at("figures")[0];
    EXPECT_EQ(figure.at("claims")[0].at("claim"), "1.7 times faster & <simpler>");
    EXPECT_EQ(figure.at("claims")[0].at("is_against"), true);
    EXPECT_EQ(figure.at("claims")[1].at("is_against"), false);
    const auto& stored = figure.at("stored");
    EXPECT_EQ(stored.at("pictures")[0].at("data").at("spheres"), "aGVsbG8=");
    const auto& curve = stored.at("plots")[0].at("curves")[0];
    EXPECT_EQ(test::from_packed<float>(curve.at("x")), (std::vector<float>{0, 1, 2}));
    const auto y = test::from_packed<float>(curve.at("y"));
    EXPECT_EQ(y[0], 0.1f);
    EXPECT_TRUE(std::isnan(y[1]));
    EXPECT_EQ(y[2], 1.0f / 3);
  }

  const std::string docs = summary_markdown(evaluation);
  EXPECT_NE(docs.find("| 1.5 times \\| slower |"), std::string::npos);
  EXPECT_NE(docs.find("\\<simpler>"), std::string::npos);
  EXPECT_NE(docs.find("Failed: 5.9: there is no"), std::string::npos);
  // Only what the thesis says counts for it.
  EXPECT_NE(docs.find("what it says?): 2 contradicts."), std::string::npos);
  EXPECT_NE(docs.find("other libraries? 2 better."), std::string::npos);
  EXPECT_NE(docs.find("own claims hold?** 2 not measured."), std::string::npos);
  EXPECT_EQ(docs.find("Arithmetic"), std::string::npos);
  EXPECT_EQ(docs.find("Drawn"), std::string::npos);
}

TEST_F(Run, TheSummaryHasItsArithmeticAndWhatIsDrawn) {
  options_.golden = "0123456789abcdef";
  const FigureSpec drawing{"3.1", "A drawing", "Drawings", make_drawing};
  const std::string docs = summary_markdown(run({kGood, drawing}));
  EXPECT_NE(docs.find("`tests/contact/golden.txt` of hash `0123456789abcdef`"), std::string::npos);
  EXPECT_NE(docs.find("\nDrawn, in the report only: 3.1.\n"), std::string::npos);
}

TEST_F(Run, ClaimsSayWhoseRowsTheyAreMadeOf) {
  run({kElsewhere});
  const Evaluation again = run({kElsewhere});  // as it was stored
  EXPECT_EQ(g_num_made, 0);
  EXPECT_NE(summary_markdown(again).find("fast (rows of another machine, commit abc) | 1 ms"),
            std::string::npos);
}

TEST_F(Run, FiguresOfAGpuStandBesideOurs) {
  const fs::path gpu = temporary_ / "gpu";
  Key key;
  key.isa = "queries on a GPU";
  FigureResult there;
  // The second claim is of an older program, and is no longer made.
  there.claims = {{some_result().claims[0].claim, "1.0 times", Verdict::differs},
                  {"newer is better", "1 ms", Verdict::better}};
  for (const char* id : {"timed", "noise"}) {
    ASSERT_TRUE(save_figure({id, key, "abc", "", 0, "", there}, gpu));
  }
  FigureSpec timed = kGood;
  timed.id = "timed";
  timed.is_on_gpu = true;
  options_.gpu_report = gpu;
  const Evaluation evaluation = run({timed, kNoise});
  // Only of a figure that times queries.
  EXPECT_EQ(count_verdicts(evaluation, Source::thesis)[Verdict::differs], 1);
  const std::string docs = summary_markdown(evaluation);
  EXPECT_NE(docs.find("\\<simpler> (queries on a GPU, commit abc) | 1.0 times | differs"),
            std::string::npos);
  EXPECT_EQ(docs.find("newer is better"), std::string::npos);
  if (report_template().empty()) return;
  const auto figures = test::report_data_of(folder_ / kReportPage).at("figures");
  EXPECT_EQ(figures[0].at("on_gpu").at("key").at("isa"), "queries on a GPU");
  EXPECT_TRUE(figures[1].at("on_gpu").is_null());
}

TEST(Speed, WhereOneCurveLiesBelowAnother) {
  const std::vector<double> x{500, 1000, 2000}, level{2, 2, 2};
  const auto words_of = [&](std::vector<double> curve) { return where_below(x, curve, level); };
  EXPECT_EQ(words_of({3, 3, 2}), "at no size up to 2000 spheres");
  EXPECT_EQ(words_of({1, 1, 1}), "at every size from 500 to 2000 spheres");
  EXPECT_EQ(words_of({1, 3, 3}), "up to 500 spheres");
  EXPECT_EQ(words_of({3, 1, 1}), "from 1000 spheres on");
  EXPECT_EQ(words_of({1, 3, 1}), "at 2 of 3 sizes");
}

TEST(Choose, NumbersOfAnId) {
  using Numbers = std::vector<std::string>;
  EXPECT_EQ(figure_numbers("5.1"), Numbers{"5.1"});
  EXPECT_EQ(figure_numbers("5.17-5.19"), (Numbers{"5.17", "5.18", "5.19"}));
  EXPECT_EQ(figure_numbers("3.7/3.8"), (Numbers{"3.7", "3.8"}));
  EXPECT_EQ(figure_numbers("3.4-6, 3.11"), (Numbers{"3.4", "3.5", "3.6", "3.11"}));
  EXPECT_EQ(figure_numbers("3.10a"), Numbers{"3.10"});
  for (const char* none : {"noise", "", "5", "5.", "5.1-noise", "-", "5.1-6.2"}) {
    EXPECT_EQ(figure_numbers(none), Numbers()) << none;
  }
}

TEST(Choose, ByIdNumberOrSection) {
  const std::vector<FigureSpec> all{kGood, kNoise, kFailing, kThrowing};
  const auto ids = [&](std::vector<std::string> words) {
    std::string text;
    const auto chosen = choose_figures(all, words);
    if (!chosen) return "error: " + chosen.error().message;
    for (const FigureSpec& figure : *chosen) text += std::string(figure.id) + " ";
    return text;
  };
  EXPECT_EQ(ids({}), "5.1-5.3 noise 5.9 5.10 ");
  EXPECT_EQ(ids({"5.2"}), "5.1-5.3 ");
  EXPECT_EQ(ids({"quality", "Noise", "noise"}), "noise 5.9 5.10 ");
  const std::string error = ids({"noize"});
  EXPECT_NE(error.find("'noize'; near are noise"), std::string::npos) << error;
}

TEST(Figures, IdsAreUniqueAndSoAreTheirFiles) {
  std::vector<std::string> stems;
  for (const FigureSpec& figure : all_figures()) stems.push_back(file_stem(figure.id));
  std::sort(stems.begin(), stems.end());
  EXPECT_EQ(std::adjacent_find(stems.begin(), stems.end()), stems.end());
}

TEST(Figures, DrawingsAreMade) {
  Settings settings;
  settings.quick = true;
  Context context(settings);
  for (const FigureSpec& figure : drawings()) {
    const auto result = figure.make(context);
    ASSERT_TRUE(result) << figure.id << ": " << result.error().message;
    EXPECT_FALSE(result->tables.empty() && result->pictures.empty()) << figure.id;
    // Drawings without a measurement have no claims.
    EXPECT_EQ(result->claims.empty(), std::string(figure.id) != "4.5-4.7") << figure.id;
  }
}

TEST(ContextTools, AreThePrefixesOfOnePacking) {
  Context context({});
  const auto large = context.tool("octahedron", 0.1, 200),
             small = context.tool("octahedron", 0.1, 50);
  ASSERT_TRUE(large && small);
  ASSERT_EQ((*small)->spheres().size(), 50u);
  for (std::size_t i = 0; i < 50; ++i) {
    EXPECT_EQ((*small)->spheres()[i].radius, (*large)->spheres()[i].radius);
  }
  EXPECT_EQ(*context.tool("octahedron", 0.1, 50), *small);
  EXPECT_FALSE(context.tool("no such shape", 0.1, 50));
  EXPECT_FALSE(context.tool("octahedron", 0.1, 0));
}

TEST(ContextFrames, AreThereOrNot) {
  Settings settings;
  Context without(settings);
  DepthStreamInfo info;
  const auto none = without.recorded("frames/pcl_person.png", info);
  ASSERT_TRUE(none);
  EXPECT_FALSE(none->has_value());
  EXPECT_FALSE(without.recorded("frames/unheard_of.png", info));

  PALPATE_DATA_OR_SKIP(data, "");
  settings.data = data;
  Context with(settings);
  for (const std::string& name : recording_names()) {
    const auto frames = with.recorded(name, info);
    ASSERT_TRUE(frames) << frames.error().message;
    ASSERT_TRUE(frames->has_value()) << name;
    EXPECT_EQ(static_cast<int>((*frames)->size()), info.num_frames);
    EXPECT_EQ((*frames)->front().width, info.width);
  }
}

TEST(TimeCalls, CountsAndOrders) {
  std::size_t calls = 0;
  const Times times = time_calls(50, [&](std::size_t i) { calls += i < 50 ? 1 : 1000; });
  EXPECT_GE(calls, 50u);
  EXPECT_LT(calls, 1000u);
  EXPECT_EQ(times.num, 50u);
  EXPECT_LE(times.median, times.p99);
  EXPECT_LE(times.p99, times.max);
  EXPECT_EQ(time_calls(0, [](std::size_t) {}).num, 0u);
}

}  // namespace
}  // namespace palpate::eval
