// Rows of graphics cards: each figure takes the newest that have all it needs, and says whose.
#include <algorithm>
#include <fstream>
#include <string>

#include <gtest/gtest.h>

#include "eval/studies/speed.h"
#include "tests/test_util/temporary_folder.h"

namespace palpate::eval {
namespace {

constexpr const char* kHead =
    "date,commit,machine,isa,program,case,calls,median_us,p99_us,p99.9_us,max_us,cpu_us,facts,load_"
    "before,command,note\n";

std::string row(const std::string& date, const std::string& commit, const std::string& name,
                double median) {
  return date + "," + commit + ",\"A card\",,gpu_bench,\"" + name + "\",100," +
         std::to_string(median) + ",9,9,9,,mean_us=1 deviation_us=1,,x,\n";
}

/// Times of the field and of simplified with one GPU and with two.
std::string two_gpus(const std::string& date, const std::string& commit, double alone,
                     double apart) {
  std::string text;
  for (const char* method : {"field", "simplified"}) {
    for (const int gpu : {0, 1}) {
      for (const char* what : {"first query of a frame", "other queries"}) {
        text += row(date, commit,
                    "two GPUs: " + std::string(method) + "; sensing on GPU " + std::to_string(gpu) +
                        "; contact on GPU 0: " + what,
                    gpu == 0 ? alone : apart);
      }
    }
  }
  return text;
}

class GpuRows : public testing::Test {
 protected:
  FigureResult make(const std::vector<std::string>& files) {
    Settings settings;
    for (std::size_t i = 0; i < files.size(); ++i) {
      settings.gpu.push_back(folder_ / (std::to_string(i) + ".csv"));
      std::ofstream(settings.gpu.back()) << kHead << files[i];
    }
    Context context(settings);
    for (const FigureSpec& figure : gpu_figures()) {
      if (std::string(figure.id) == "two-gpus") return figure.make(context).value();
    }
    return {};
  }

  const test::TemporaryFolder folder_;
};

TEST_F(GpuRows, OfTheNewestFileThatHasThemAll) {
  const std::string whole = two_gpus("2026-01-02", "whole", 30, 20);
  const std::string newer = row("2026-01-03", "newer", "floor: one launch", 6);
  FigureResult result = make({two_gpus("2026-01-01", "old", 30, 60), whole, newer});
  EXPECT_EQ(result.rows_of, "A card, commit whole");
  ASSERT_EQ(result.claims.size(), 1u);
  EXPECT_EQ(result.claims[0].verdict, Verdict::agrees);
  // Whatever the order of the files; of one day, the last.
  EXPECT_EQ(make({newer, whole, two_gpus("2026-01-01", "old", 30, 60)}).rows_of,
            "A card, commit whole");
  result = make({whole, two_gpus("2026-01-02", "later", 30, 60)});
  EXPECT_EQ(result.rows_of, "A card, commit later");
  EXPECT_EQ(result.claims[0].verdict, Verdict::contradicts);
}

TEST_F(GpuRows, OfOneCommitOnly) {
  const std::string all = two_gpus("2026-01-02", "one", 30, 20);
  const std::size_t half = all.find("two GPUs: simplified");
  const std::size_t cut = all.rfind('\n', half) + 1;
  std::string mixed = all;
  for (std::size_t at; (at = mixed.find(",one,", cut)) != std::string::npos;) {
    mixed.replace(at, 5, ",two,");
  }
  EXPECT_EQ(make({mixed}).claims[0].verdict, Verdict::not_measured);
  EXPECT_EQ(make({}).claims[0].verdict, Verdict::not_measured);
  EXPECT_EQ(make({all}).claims[0].verdict, Verdict::agrees);
}

TEST_F(GpuRows, TimesThatAreAlikeAreATie) {
  EXPECT_EQ(make({two_gpus("2026-01-02", "a", 25.7, 25.6)}).claims[0].verdict, Verdict::differs);
}

}  // namespace
}  // namespace palpate::eval
