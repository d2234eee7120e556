// Texts that quote tables of the report.
#include <filesystem>
#include <fstream>
#include <sstream>
#include <string>

#include <gtest/gtest.h>

#include "eval/report/doc_tables.h"
#include "eval/report/report.h"
#include "tests/test_util/temporary_folder.h"

namespace palpate::eval {
namespace {

namespace fs = std::filesystem;

Result<FigureResult> make_nothing(Context&) { return FigureResult(); }

Evaluation some_evaluation() {
  StoredFigure stored;
  stored.id = "edges";
  stored.result.claims = {{"It stops.", "It stops.", Verdict::agrees}};
  stored.result.tables = {{"Error, %", {"method", "cut"}, {{"graph|cap", "1.2"}, {"field", ""}}}};
  StoredFigure failed;
  failed.id = "5.1";
  failed.failure = "out of spheres";
  Evaluation evaluation;
  evaluation.figures = {
      {{"edges", "Edges", "Time", make_nothing}, stored, true, std::nullopt},
      {{"5.1", "Times", "Speed", make_nothing}, failed, true, std::nullopt},
      {{"5.2", "Times", "Speed", make_nothing}, std::nullopt, false, std::nullopt}};
  return evaluation;
}

std::string quoting(const std::string& quote, const std::string& inner) {
  return "Before.\n<!-- eval " + quote + " -->\n" + inner + "<!-- /eval -->\nAfter.\n";
}

std::string error_of(const std::string& text) {
  const auto made = with_tables(text, some_evaluation());
  return made ? "no error" : made.error().message;
}

TEST(DocTables, TakeThePlaceOfWhatStoodThere) {
  const std::string desired =
      quoting("edges: Error, %",
              "\n| method | cut |\n|---|---|\n| graph\\|cap | 1.2 |\n| field |  |\n\n"
              "*Evaluation, edges: `make eval FIGURE=edges`.*\n\n");
  for (const char* before : {"", "| an | older |\n|---|---|\n", "\n\n"}) {
    EXPECT_EQ(with_tables(quoting("edges: Error, %", before), some_evaluation()).value(), desired);
  }
  EXPECT_EQ(with_tables(desired, some_evaluation()).value(), desired);
  EXPECT_EQ(with_tables(desired + desired, some_evaluation()).value(), desired + desired);
}

TEST(DocTables, SayWhoseRowsTheyAre) {
  Evaluation evaluation = some_evaluation();
  evaluation.figures[0].stored->result.rows_of = "a card, commit abc";
  const std::string made = with_tables(quoting("edges: Error, %", ""), evaluation).value();
  EXPECT_NE(made.find("`make eval FIGURE=edges`; rows of a card, commit abc.*"), std::string::npos)
      << made;
}

TEST(DocTables, StayAsTheyAreWithoutTheirFigure) {
  for (const char* quote : {"5.1: Median, ms", "5.2: Median, ms"}) {
    const std::string text = quoting(quote, "| what | was |\n");
    EXPECT_EQ(with_tables(text, some_evaluation()).value(), text);
  }
  EXPECT_EQ(with_tables("No quotes.\n\n<!-- a note -->\n", some_evaluation()).value(),
            "No quotes.\n\n<!-- a note -->\n");
}

TEST(DocTables, StayAsTheyAreWhereNothingIsMeasured) {
  Evaluation evaluation = some_evaluation();
  evaluation.figures[0].stored->result.tables.clear();
  EXPECT_FALSE(with_tables(quoting("edges: Error, %", "| was |\n"), evaluation));
  evaluation.figures[0].stored->result.claims[0].verdict = Verdict::not_measured;
  EXPECT_EQ(with_tables(quoting("edges: Error, %", "| was |\n"), evaluation).value(),
            quoting("edges: Error, %", "| was |\n"));
}

TEST(DocTables, WrongMarksAreErrorsWithTheirLine) {
  EXPECT_EQ(error_of(quoting("5.9: Median", "")),
            "line 2: there is no figure '5.9'; palpate_eval --list shows all");
  EXPECT_EQ(error_of(quoting("edges: Volume", "")),
            "line 2: figure edges has no table 'Volume'; it has 'Error, %'");
  EXPECT_NE(error_of(quoting("edges", "")).find("line 2: '<!-- eval edges -->' is not"),
            std::string::npos);
  EXPECT_NE(error_of("<!-- eval edges: Error, % -->\n| 1 |\n").find("line 1: no '<!-- /eval -->'"),
            std::string::npos);
  EXPECT_NE(error_of("\n<!-- /eval -->\n").find("line 2: '<!-- /eval -->' has no partner"),
            std::string::npos);
  const std::string twice = "<!-- eval edges: Error, % -->\n<!-- eval edges: Error, % -->\n";
  EXPECT_NE(error_of(twice).find("line 2: "), std::string::npos);
}

class Docs : public testing::Test {
 protected:
  void SetUp() override { fs::create_directories(folder_ / "guide"); }

  void write(const char* name, const std::string& text) { std::ofstream(folder_ / name) << text; }
  std::string read(const char* name) const {
    std::ostringstream text;
    text << std::ifstream(folder_ / name).rdbuf();
    return text.str();
  }

  const test::TemporaryFolder temporary_;
  const fs::path folder_ = temporary_.path();
  const std::vector<fs::path> folder_alone_{folder_};
};

TEST_F(Docs, AllTextsOfAFolderAreWritten) {
  write("guide/edges.md", quoting("edges: Error, %", ""));
  write("guide/edges.txt", quoting("edges: Error, %", ""));
  ASSERT_TRUE(write_docs(some_evaluation(), folder_alone_));
  EXPECT_NE(read("guide/edges.md").find("| field |  |"), std::string::npos);
  EXPECT_EQ(read("guide/edges.txt"), quoting("edges: Error, %", ""));
  EXPECT_EQ(read("evaluation.md"), summary_markdown(some_evaluation()));
}

TEST_F(Docs, OfOneTextOnlyThat) {
  write("README.md", quoting("edges: Error, %", ""));
  const std::vector<fs::path> text{folder_ / "README.md"};
  ASSERT_TRUE(write_docs(some_evaluation(), text));
  EXPECT_NE(read("README.md").find("| field |  |"), std::string::npos);
  EXPECT_FALSE(fs::exists(folder_ / "evaluation.md"));
}

TEST_F(Docs, NothingIsWrittenIfOneTextIsWrong) {
  write("guide/a.md", quoting("edges: Error, %", ""));
  write("guide/b.md", quoting("edges: Eror, %", ""));
  const Status status = write_docs(some_evaluation(), folder_alone_);
  ASSERT_FALSE(status);
  EXPECT_NE(status.error().message.find("b.md, line 2: "), std::string::npos);
  EXPECT_EQ(read("guide/a.md"), quoting("edges: Error, %", ""));
  EXPECT_FALSE(fs::exists(folder_ / "evaluation.md"));
  // The good one comes first.
  const std::vector<fs::path> in_order{folder_ / "guide/a.md", folder_ / "guide/b.md"};
  EXPECT_FALSE(write_docs(some_evaluation(), in_order));
  EXPECT_EQ(read("guide/a.md"), quoting("edges: Error, %", ""));
  const std::vector<fs::path> nowhere{folder_ / "nowhere"};
  EXPECT_FALSE(write_docs(some_evaluation(), nowhere));
}

}  // namespace
}  // namespace palpate::eval
