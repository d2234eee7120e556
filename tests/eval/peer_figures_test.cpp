// The figures on other libraries, from files written by hand.
#include <filesystem>
#include <fstream>
#include <set>

#include <gtest/gtest.h>

#include "eval/context.h"
#include "eval/figure.h"
#include "eval/report/csv.h"
#include "tests/test_util/temporary_folder.h"

namespace palpate::eval {
namespace {

constexpr const char* kHead =
    "# date: 2026-11-21\n# machine: a machine\n# commit: abc\n# settings: 3 passes; load 0.1\n"
    "case,peer,ours_median_us,ours_p99_us,peer_median_us,peer_p99_us,build_us,facts\n";

class Peers : public testing::Test {
 protected:
  FigureResult make(const std::string& id) const {
    Settings settings;
    settings.peers = path_;
    Context context(settings);
    for (const FigureSpec& spec : peer_figures()) {
      if (spec.id != id) continue;
      EXPECT_STREQ(spec.section, "Peers");
      const auto result = spec.make(context);
      EXPECT_TRUE(result);
      if (result) return *result;
    }
    ADD_FAILURE() << "no figure " << id;
    return {};
  }
  FigureResult make(const std::string& id, const std::string& content) const {
    std::ofstream(path_) << content;
    return make(id);
  }

  const test::TemporaryFolder folder_;
  const std::filesystem::path path_ = folder_ / "peers.csv";
};

double number(const FigureResult& result, const std::string& key) {
  for (const Number& number : result.numbers) {
    if (number.key == key) return number.value;
  }
  ADD_FAILURE() << "no number " << key;
  return 0;
}

bool says(const std::vector<std::string>& notes, const std::string& words) {
  for (const std::string& note : notes) {
    if (note.find(words) != std::string::npos) return true;
  }
  return false;
}

TEST_F(Peers, WithoutAFileSayHowToMakeOne) {
  for (const char* id : {"peers-boundary", "peers-normals"}) {
    for (const char* content : {"", kHead, "no, table\n\"", "case,peer\nboundary/spheres:1,X\n"}) {
      const FigureResult result = *content == '\0' ? make(id) : make(id, content);
      ASSERT_EQ(result.claims.size(), 1u) << content;
      EXPECT_EQ(result.claims[0].verdict, Verdict::not_measured);
      EXPECT_EQ(result.claims[0].source, Source::ours);
      EXPECT_NE(result.claims[0].measured.find("build/peers/bin/bench_peers --csv"),
                std::string::npos);
      EXPECT_TRUE(result.numbers.empty());
    }
  }
}

TEST_F(Peers, BoundaryRatiosAndVerdicts) {
  const FigureResult result =
      make("peers-boundary",
           std::string(kHead) +
               "boundary/spheres:17000/depth:50/ask:sums,Tree,100,150,2500,2600,34000,touched=196\n"
               "boundary/spheres:1000/depth:50/ask:sums,Tree,80,90,160,170,34000,touched=39\n"
               "boundary/spheres:1000/depth:50/ask:which,Tree,80,90,40,50,34000,touched=39\n"
               "boundary/spheres:17000/depth:50/ask:which,Tree,100,150,400,450,34000,\n"
               "boundary/spheres:1000/depth:50/ask:which,Other (fast tree),80,90,20,50,100,\n");
  EXPECT_EQ(number(result, "tree.sums.17000.50.ratio"), 25);
  EXPECT_EQ(number(result, "tree.sums.1000.50.ratio"), 2);
  EXPECT_EQ(number(result, "tree.which.1000.50.ratio"), 0.5);
  EXPECT_EQ(number(result, "other-fast-tree.which.1000.50.ratio"), 0.25);
  EXPECT_NEAR(number(result, "tree.tree_share_of_frame"), 1.02, 1e-9);
  ASSERT_EQ(result.claims.size(), 3u);
  EXPECT_EQ(result.claims[0].verdict, Verdict::better);
  EXPECT_NE(result.claims[0].measured.find("2 to 25 times"), std::string::npos)
      << result.claims[0].measured;
  EXPECT_NE(result.claims[0].measured.find("34 ms"), std::string::npos)
      << result.claims[0].measured;
  EXPECT_EQ(result.claims[1].verdict, Verdict::even);
  EXPECT_EQ(result.claims[2].verdict, Verdict::worse);
  EXPECT_EQ(result.claims[2].measured.find("frame"), std::string::npos)
      << result.claims[2].measured;
  // Curves rise in x, whatever the order of the file.
  ASSERT_EQ(result.plots.size(), 2u);
  EXPECT_EQ(result.plots[0].curves[0].x, (std::vector<double>{1000, 17000}));
  EXPECT_EQ(result.plots[0].curves[0].y, (std::vector<double>{2, 25}));
  ASSERT_EQ(result.tables.size(), 2u);
  EXPECT_EQ(result.tables[0].rows.size(), 5u);
  EXPECT_TRUE(says(result.notes, "one thread; 3 passes; load 0.1."));
  EXPECT_EQ(result.rows_of, "a machine, commit abc");
  EXPECT_FALSE(says(result.notes, "damaged"));
}

TEST_F(Peers, DamagedLinesAreLeftOutAndCounted) {
  const std::string good = "boundary/spheres:1000/depth:10/ask:sums,Tree,80,90,160,170,0,\n";
  const FigureResult result =
      make("peers-boundary",
           kHead + good +
               "boundary/spheres:1000/depth:10/ask:sums,Tree,80\n"               // cut off
               "boundary/spheres:1000/depth:10/ask:sums,Tree,x,90,160,170,0,\n"  // a word
               "boundary/spheres:1000/depth:10/ask:sums,Tree,nan,90,inf,1,0,\n"
               "boundary/spheres:1000/depth:10/ask:sums,Tree,80,90,0,170,0,\n"
               "boundary/spheres:1000/depth:10/ask:sums,Tree,80,90,-3,170,0,\n"
               "boundary/spheres:1000/depth:10/ask:sums,,80,90,160,170,0,\n"
               "boundary/spheres:1000/ask:sums,Tree,80,90,160,170,0,\n"
               "boundary/spheres:1000/depth:10/ask:me,Tree,80,90,160,170,0,\n"
               "boundary/spheres:1000/depth:10/ask:sums,Tree,1,1,1,\"1,1,\n"
               "\n"
               "elsewhere,Tree,1,1,1,1,1,\n");
  EXPECT_EQ(result.tables.at(0).rows.size(), 1u);
  EXPECT_EQ(number(result, "tree.sums.1000.10.ratio"), 2);
  EXPECT_TRUE(says(result.notes, "9 damaged lines")) << result.notes.back();
}

TEST_F(Peers, OfTwoRowsOfACaseTheLastCounts) {
  const FigureResult result =
      make("peers-boundary", std::string(kHead) +
                                 "boundary/spheres:1000/depth:10/ask:sums,Tree,80,90,160,170,0,\n"
                                 "boundary/spheres:1000/depth:10/ask:sums,tree,80,90,240,250,0,\n");
  std::set<std::string> keys;
  for (const Number& n : result.numbers) EXPECT_TRUE(keys.insert(n.key).second) << n.key;
  EXPECT_EQ(number(result, "tree.sums.1000.10.ratio"), 3);
}

TEST_F(Peers, NormalsCountTimeAndError) {
  const FigureResult result =
      make("peers-normals",
           std::string(kHead) +
               "normals/input:raw,Slow,2000,2100,4000,4100,0,ours_error=4 peer_error=5\n"
               "normals/input:filtered,Slow,2000,2100,4000,4100,0,ours_error=2.5 peer_error=2.5\n"
               "normals/input:raw,Exact,2000,2100,3000,3100,0,ours_error=4 peer_error=3\n"
               "normals/input:raw,Quick,2000,2100,1000,1100,0,ours_error=4 peer_error=4\n"
               "filter/input:raw,Filter,1500,1600,3000,3100,0,ours_error=0.4 peer_error=0.42\n");
  ASSERT_EQ(result.claims.size(), 4u);
  EXPECT_EQ(result.claims[0].verdict, Verdict::better);
  EXPECT_EQ(result.claims[1].verdict, Verdict::even);
  EXPECT_EQ(result.claims[2].verdict, Verdict::worse);
  EXPECT_EQ(result.claims[3].verdict, Verdict::better);
  EXPECT_NE(result.claims[3].measured.find("mm"), std::string::npos);
  EXPECT_EQ(number(result, "slow.normals.raw.ratio"), 2);
  EXPECT_EQ(number(result, "quick.normals.raw.ratio"), 0.5);
  EXPECT_EQ(number(result, "filter.filter.raw.ratio"), 2);
  ASSERT_EQ(result.plots.size(), 1u);
  EXPECT_EQ(result.plots[0].curves.size(), 4u);  // ours and three; the filter has no normals
  EXPECT_EQ(result.plots[0].curves[0].x, (std::vector<double>{4, 2.5}));
}

TEST(Csv, FieldsByName) {
  EXPECT_EQ(finite_number("1.5e3"), 1500);
  for (const char* text : {"", "nan", "inf", "1,5", "3 ms", "x"}) {
    EXPECT_FALSE(finite_number(text)) << text;
  }
  EXPECT_EQ(named_values("boundary/spheres:1000", '/', ':'),
            (std::map<std::string, std::string>{{"boundary", ""}, {"spheres", "1000"}}));
  const test::TemporaryFolder folder;
  const auto path = folder / "facts.csv";
  std::ofstream(path) << "# a: b: c\r\nx,y\r\n1,\"2,3\"\r\n4\r\n";
  const CsvFile file = read_csv(path);
  EXPECT_EQ(file.fact("a"), "b: c");
  EXPECT_EQ(file.fact("x"), "");
  ASSERT_EQ(file.rows.size(), 1u);
  EXPECT_EQ(file.rows[0].at("y"), "2,3");
  EXPECT_EQ(file.num_damaged, 1);
}

}  // namespace
}  // namespace palpate::eval
